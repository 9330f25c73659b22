import re
from pathlib import Path

import numpy as np
import pytest

from actorsnerf_preprocess.source import Finding, Found, OpenOptions
from actorsnerf_preprocess.zju_protocol import (
    actor_of,
    protocol_findings,
    protocol_notes,
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


@pytest.mark.parametrize(
    ("name", "cameras", "count", "reason"),
    [
        (
            "CoreView_387",
            1,
            400,
            r"more than 301 frames and more than one camera, and .* 400 and 1",
        ),
        ("my_393", 3, 301, r"held out, with generic lists: .* 301 and 3"),
        ("394", 3, 4, r"held out, its 4 frames give no few-shot list: .* 4 and 3"),
        ("gLH_sFM_cAll_d16_mLH2_ch03", 3, 400, "the published lists are for the videos of AIST"),
    ],
)
def test_a_published_test_actor_is_held_out_whatever_protocol_applies(
    name: str, cameras: int, count: int, reason: str
) -> None:
    found, frames = subject(name), tuple(range(count))
    protocol = protocol_of(found, OpenOptions(), CAMERAS[:cameras], frames)
    assert (protocol.name, protocol.role) == ("generic", "held_out")
    (finding,) = protocol_findings(found, protocol, CAMERAS[:cameras], frames)
    assert finding.severity == "warning" and re.search(reason, finding.sentence)
    assert protocol_notes(found, protocol, CAMERAS[:cameras], frames) == (finding.sentence,)
    drawn = subject(name, drawn=True)
    protocol = protocol_of(drawn, OpenOptions(), CAMERAS[:cameras], frames)
    assert protocol.role == "pretraining"
    assert protocol_findings(drawn, protocol, CAMERAS[:cameras], frames) == ()


def test_a_file_says_why_its_protocol_is_the_generic_one() -> None:
    def notes(name: str) -> tuple[str, ...]:
        protocol = protocol_of(subject(name), OpenOptions(), CAMERAS, FRAMES)
        assert protocol_findings(subject(name), protocol, CAMERAS, FRAMES) == ()
        return protocol_notes(subject(name), protocol, CAMERAS, FRAMES)

    assert notes("377") == ()
    assert notes("aunt") == ("The actor is in no published list and counts as pretraining.",)
    (note,) = notes("CoreView_390")  # begins at position 600
    assert note.startswith("The published protocol does not apply to these 20 frames")


@pytest.mark.parametrize("name", ["my_aunt", "aunt"])
def test_an_actor_is_held_out_by_any_of_its_names(name: str) -> None:
    options = OpenOptions(held_out=(name,))
    assert protocol_of(subject("my_aunt"), options, CAMERAS, FRAMES).role == "held_out"
    assert protocol_of(subject("my_uncle"), options, CAMERAS, FRAMES).role == "pretraining"


@pytest.mark.parametrize("name", ["377", "zju-377", "CoreView_377"])
def test_a_published_actor_is_held_out_where_the_user_says_so(name: str) -> None:
    found, options, frames = subject("CoreView_377"), OpenOptions(held_out=(name,)), range(400)
    protocol = protocol_of(found, options, CAMERAS, tuple(frames))
    assert (protocol.name, protocol.role) == ("generic", "held_out")
    assert protocol.shots
    (note,) = protocol_notes(found, protocol, CAMERAS, tuple(frames))
    assert note == "A published pre-training actor, held out because the user named it."
    options = OpenOptions(held_out=("387",))
    tester = protocol_of(subject("CoreView_387"), options, CAMERAS, tuple(range(600)))
    assert tester.name == "actorsnerf-zju"


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
