from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from actorsnerf_datasets.writer import StoredPicture
from actorsnerf_preprocess.conclusion import concluded
from actorsnerf_preprocess.picture_tasks import Outcome
from actorsnerf_preprocess.pictures import Crop
from actorsnerf_preprocess.probes import Probe
from actorsnerf_preprocess.source import OpenOptions
from actorsnerf_preprocess.zju import find_zju, open_zju


def test_lists_lose_what_the_second_pass_lost(
    write_zju: Callable[..., Any], tmp_path: Path, tiny_body: Path
) -> None:
    tree = write_zju(tmp_path / "CoreView_dancer", frames=range(40), cameras=2, size=96)
    source = open_zju(find_zju(tree.root)[0], OpenOptions(tiny_body, "all", ("dancer",)))
    places = [(camera, frame) for camera in range(2) for frame in range(40)]
    box = Crop(0, 0, 8, 8)
    probes = [Probe(*at, box, "", "a.jpg", np.nan, np.nan, False, "") for at in places]
    kept = [
        Outcome(*at, StoredPicture(*at, (0, 0), b"", b""), "", "", touching=False) for at in places
    ]
    whole = concluded(source, probes, kept, 1.0)
    shots = {(one.name, one.list_name): one for one in whole.protocols[0].shots}
    lost = shots["fewshot-10", "auto"].support[0]
    official = shots["fewshot-10", "official"]
    outcomes = [
        replace(each, stored=None, reason="empty mask") if (each.camera, each.frame) == (0, lost)
        else each
        for each in kept
    ]  # fmt: skip
    found = concluded(source, probes, outcomes, 1.0)
    assert "1 of 80 pictures are not stored: empty mask." in found.notes
    assert whole.notes == source.notes
    for one in found.protocols[0].shots:
        assert lost not in {*one.frames, *one.support}
    assert lost in {*official.frames, *shots["fewshot-10", "auto"].frames}
