from actorsnerf_datasets.types import Protocol, Shots
from actorsnerf_preprocess.usable_lists import usable_protocol

PROTOCOL = Protocol(
    name="generic",
    role="held_out",
    training_camera="a",
    evaluation_cameras=("b", "c"),
    pretraining_frames=(),
    evaluation_frames=(10, 11, 12),
    shots=(
        Shots("fewshot-5", "official", (1, 2, 3, 4, 5), (1, 3, 5)),
        Shots("fewshot-5", "auto", (1, 2, 3, 4, 5), (1, 2, 3)),
    ),
)
ALL = {("a", frame) for frame in range(1, 6)} | {(c, f) for c in "bc" for f in (10, 11, 12)}


def test_nothing_changes_when_all_is_usable() -> None:
    assert usable_protocol(PROTOCOL, ALL) == (PROTOCOL, ())


def test_an_unusable_frame_leaves_the_list_and_is_said() -> None:
    changed, notes = usable_protocol(PROTOCOL, ALL - {("a", 4)})
    assert [shots.frames for shots in changed.shots] == [(1, 2, 3, 5)] * 2
    assert notes[0] == ("1 of 5 frames of fewshot-5 (official) are unusable and left out: 4.")


def test_a_list_without_one_of_its_supports_is_left_out() -> None:
    changed, notes = usable_protocol(PROTOCOL, ALL - {("a", 5)})
    assert [shots.list_name for shots in changed.shots] == ["auto"]
    assert notes[0] == "fewshot-5 (official) is left out: a support frame is unusable."


def test_an_evaluation_frame_needs_one_camera() -> None:
    assert usable_protocol(PROTOCOL, ALL - {("b", 10)})[0].evaluation_frames == (10, 11, 12)
    changed, notes = usable_protocol(PROTOCOL, ALL - {("b", 10), ("c", 10)})
    assert changed.evaluation_frames == (11, 12)
    assert notes == ("1 of 3 evaluation frames are unusable and left out: 10.",)


def test_frames_of_another_camera_do_not_count() -> None:
    changed, _ = usable_protocol(PROTOCOL, (ALL - {("a", 2)}) | {("b", 2)})
    assert changed.shots[0].frames == (1, 3, 4, 5)
