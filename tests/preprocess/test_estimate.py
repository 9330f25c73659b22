from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from actorsnerf_preprocess.estimate import estimate
from actorsnerf_preprocess.pictures import PictureOptions
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import OpenOptions
from actorsnerf_preprocess.zju import find_zju, open_zju

WriteTree = Callable[..., Any]


def test_the_estimated_size_is_near_the_real_one(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    write_zju(tmp_path / "CoreView_377", frames=range(12), cameras=1, size=400)
    source = open_zju(find_zju(tmp_path)[0], OpenOptions(body_model=tiny_body))
    guess = estimate(source, PictureOptions())
    report = prepare_sequence(source, tmp_path, PrepareOptions(contact_sheet=False))
    assert report is not None
    assert guess.pictures == report.asked == 12
    assert guess.sampled == 8
    assert guess.bytes == pytest.approx(report.bytes, rel=0.3)
    assert guess.seconds > 0
