from pathlib import Path

import numpy as np
import pytest

from actorsnerf_preprocess.source import Finding, Found, OpenOptions
from actorsnerf_preprocess.zju_protocol import (
    actor_of,
    protocol_of,
    wanted_pairs,
    weighed_findings,
)

CAMERAS = ("Camera_B1", "Camera_B2", "Camera_B3")
FRAMES = tuple(range(20))


def subject(name: str, drawn: bool = False) -> Found:
    return Found(name, Path("raw") / name, "classic", "synthetic" if drawn else "zju-mocap")


def test_a_number_is_an_actor_of_the_data_set_unless_it_is_drawn() -> None:
    assert actor_of(subject("CoreView_387")) == "zju-387"
    assert actor_of(subject("my_387")) == "zju-387"
    assert actor_of(subject("CoreView_387", drawn=True)) == "387"
    assert actor_of(subject("aunt")) == "aunt"


def test_published_subjects_have_the_published_protocol_unless_they_are_drawn() -> None:
    options = OpenOptions()
    assert protocol_of(subject("CoreView_377"), options, CAMERAS, FRAMES).name == "actorsnerf-zju"
    drawn = protocol_of(subject("CoreView_377", drawn=True), options, CAMERAS, FRAMES)
    assert (drawn.name, drawn.role) == ("generic", "pretraining")


@pytest.mark.parametrize("name", ["my_aunt", "aunt"])
def test_an_actor_is_held_out_by_any_of_its_names(name: str) -> None:
    options = OpenOptions(held_out=(name,))
    assert protocol_of(subject("my_aunt"), options, CAMERAS, FRAMES).role == "held_out"
    assert protocol_of(subject("my_uncle"), options, CAMERAS, FRAMES).role == "pretraining"


def test_only_the_pairs_of_the_protocol_are_wanted_unless_all_are_asked_for() -> None:
    protocol = protocol_of(subject("aunt"), OpenOptions(), CAMERAS, FRAMES)
    wanted = wanted_pairs(protocol, OpenOptions(), CAMERAS, FRAMES)
    assert wanted.tolist() == [[True] * 20, [False] * 20, [False] * 20]
    assert wanted_pairs(protocol, OpenOptions(pairs="all"), CAMERAS, FRAMES).all()


def test_absent_pictures_matter_only_if_a_wanted_pair_lacks_its_own() -> None:
    findings = (
        Finding("warning", "pictures", "2 pictures are missing."),
        Finding("warning", "masks", "1 mask is missing."),
    )
    wanted = np.array([[True, True], [False, False]])
    there = frozenset({(0, 0), (0, 1)})
    weighed = weighed_findings(findings, wanted, there, {"pictures"})
    assert [finding.severity for finding in weighed] == ["note", "warning"]
    assert weighed_findings(findings, wanted, there - {(0, 1)}, {"pictures"}) == findings
