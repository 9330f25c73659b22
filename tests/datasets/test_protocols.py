import dataclasses

import numpy as np
import pytest

from actorsnerf_datasets.protocols import (
    aist_protocol,
    generic_protocol,
    needed_pairs,
    with_automatic_lists,
    zju_protocol,
)
from actorsnerf_datasets.published import AIST_SEQUENCES
from actorsnerf_datasets.types import Int64, Protocol, SequenceHeader, Shots

ZJU_CAMERAS = [f"Camera_B{number}" for number in range(1, 24)]
ZJU_21_CAMERAS = [f"Camera ({number})" for number in (*range(1, 20), 22, 23)]
ZJU_FRAMES = {
    **{"313": 1470, "315": 2185, "377": 617, "386": 646, "387": 654, "390": 1171},
    **{"392": 556, "393": 658, "394": 859, "396": 1350},
}
AIST_CAMERAS = [f"c{number:02d}" for number in range(1, 10)]


def _zju_numbers(subject: str, count: int | None = None) -> Int64:
    first = 1 if subject in ("313", "315") else 0
    return np.arange(first, first + (count or ZJU_FRAMES[subject]), dtype=np.int64)


def _zju(subject: str, count: int | None = None) -> Protocol:
    cameras = ZJU_21_CAMERAS if subject in ("313", "315") else ZJU_CAMERAS
    found = zju_protocol(f"CoreView_{subject}", cameras, _zju_numbers(subject, count))
    assert found is not None
    return found


def _aist(dancer: str, last: int = 2400) -> Protocol:
    numbers = np.arange(200, last, 4, dtype=np.int64)
    found = aist_protocol(AIST_SEQUENCES[dancer], AIST_CAMERAS, numbers)
    assert found is not None
    return found


def _list(protocol: Protocol, name: str, list_name: str = "official") -> Shots:
    (found,) = (s for s in protocol.shots if (s.name, s.list_name) == (name, list_name))
    return found


def test_the_zju_study_needs_6393_pictures() -> None:
    # Of 396, frames 0 to 1349: what follows is not read (`zju_tree`).
    assert sum(len(needed_pairs(_zju(subject))) for subject in ZJU_FRAMES) == 6393
    assert len(needed_pairs(_zju("387"))) == 301 + 25 * 22
    assert len(needed_pairs(_zju("313"))) == 550


def test_positions_become_numbers() -> None:
    assert _zju("313").pretraining_frames == tuple(range(1, 551))
    assert _zju("313").training_camera == "Camera (1)"
    assert _zju("390").pretraining_frames == tuple(range(600, 1150))
    assert _zju("396").pretraining_frames == tuple(range(810, 1350))
    assert _zju("396", 1400).pretraining_frames == tuple(range(810, 1360))
    assert not _zju("377").evaluation_frames
    assert not _zju("377").shots


def test_a_held_out_zju_subject() -> None:
    protocol = _zju("387")
    assert (protocol.role, protocol.pretraining_frames) == ("held_out", ())
    assert protocol.evaluation_frames == tuple(range(301, 550, 10))
    assert protocol.evaluation_cameras == tuple(ZJU_CAMERAS[1:])
    assert _list(protocol, "fewshot-5").frames == (0, 75, 150, 225, 300)
    assert _list(protocol, "fewshot-5").support == (75, 225, 300)
    assert _list(protocol, "fewshot-10").frames == tuple(range(30, 301, 30))
    assert _list(protocol, "fewshot-30").support == (80, 230, 300)
    assert _list(protocol, "fewshot-300").frames == tuple(range(1, 301))
    assert _list(protocol, "short-video").frames == tuple(range(10, 101, 10))
    assert _list(protocol, "short-video").support == (10, 70, 100)
    assert _list(_zju("394"), "fewshot-100").support == (3, 150, 300)
    for count in (5, 10, 30, 100, 300):
        assert len(_list(protocol, f"fewshot-{count}").frames) == count


@pytest.mark.parametrize("name", ["387", "CoreView_387", "my_387"])
def test_subjects_by_any_of_their_names(name: str) -> None:
    assert zju_protocol(name, ZJU_CAMERAS, _zju_numbers("387")) == _zju("387")


def test_where_the_zju_protocol_does_not_apply() -> None:
    assert zju_protocol("CoreView_395", ZJU_CAMERAS, _zju_numbers("387")) is None
    assert zju_protocol("anna", ZJU_CAMERAS, _zju_numbers("387")) is None
    assert zju_protocol("CoreView_1387", ZJU_CAMERAS, _zju_numbers("387")) is None
    assert zju_protocol("387", ZJU_CAMERAS, _zju_numbers("387", 301)) is None
    assert zju_protocol("390", ZJU_CAMERAS, _zju_numbers("390", 600)) is None


def test_a_short_zju_sequence_gives_a_short_list() -> None:
    assert len(_zju("377", 60).pretraining_frames) == 60


@pytest.mark.parametrize(
    ("dancer", "counts"),
    [
        ("d16", (5, 10, 30, 100, 297)),
        ("d17", (5, 10, 30, 100, 297)),
        ("d18", (5, 9, 29, 99, 297)),
        ("d19", (5, 10, 30, 99, 297)),
        ("d20", (5, 10, 30, 100, 297)),
    ],
)
def test_distinct_frames_of_the_aist_lists(dancer: str, counts: tuple[int, ...]) -> None:
    protocol = _aist(dancer)
    found = [len(_list(protocol, f"fewshot-{count}").frames) for count in (5, 10, 30, 100, 300)]
    assert tuple(found) == counts


def test_a_held_out_dancer() -> None:
    protocol = _aist("d16")
    assert protocol.evaluation_cameras == ("c02", "c03", "c04", "c05", "c06", "c07", "c08")
    assert protocol.training_camera == "c01"
    ten = _list(protocol, "fewshot-10")
    assert ten.frames == (200, 204, 320, 440, 560, 680, 800, 832, 844, 920)
    assert ten.support == (200, 832, 840)
    assert ("c01", 840) in needed_pairs(protocol)
    assert _list(protocol, "short-video").frames == tuple(range(200, 561, 40))
    # 550 positions, video frames 200 to 2396: from 300 to before the last, every tenth.
    assert protocol.evaluation_frames == tuple(range(1400, 2396, 40))


def test_aist_pretraining_takes_500_positions_or_what_there_is() -> None:
    assert _aist("d01").pretraining_frames == tuple(range(200, 2200, 4))
    assert _aist("d30", 1000).pretraining_frames == tuple(range(200, 1000, 4))
    pretraining = [d for d in AIST_SEQUENCES if _aist(d).role == "pretraining"]
    assert len(pretraining) == 25


def test_all_video_frames_may_be_given_and_cameras_may_be_missing() -> None:
    numbers = np.arange(2398, dtype=np.int64)
    cameras = ["c01", "c02", "c05", "c09"]
    found = aist_protocol(AIST_SEQUENCES["d16"], cameras, numbers)
    assert found is not None
    assert found.evaluation_frames == _aist("d16").evaluation_frames
    assert found.evaluation_cameras == ("c02", "c05")


def test_where_the_aist_protocol_does_not_apply() -> None:
    numbers = np.arange(200, 2400, 4, dtype=np.int64)
    assert aist_protocol("gBR_sBM_cAll_d04_mBR0_ch01", AIST_CAMERAS, numbers) is None
    assert aist_protocol(AIST_SEQUENCES["d16"], AIST_CAMERAS[1:], numbers) is None
    assert aist_protocol(AIST_SEQUENCES["d16"], AIST_CAMERAS, numbers[:300]) is None


def test_the_generic_protocol_of_a_long_sequence() -> None:
    protocol = generic_protocol("held_out", ["a", "b", "c"], np.arange(1, 601, dtype=np.int64))
    assert _list(protocol, "fewshot-10").frames == tuple(range(30, 301, 30))
    assert _list(protocol, "fewshot-300").frames == tuple(range(1, 301))
    assert _list(protocol, "short-video").frames == tuple(range(10, 101, 10))
    assert _list(protocol, "fewshot-30").support == (100, 200, 300)
    assert protocol.evaluation_frames == tuple(range(301, 601, 12))
    assert protocol.evaluation_cameras == ("b", "c")
    assert protocol.training_camera == "a"


@pytest.mark.parametrize("count", [9, 12, 40, 57, 83, 200, 499, 500, 1300])
def test_generic_lists_are_distinct_and_apart(count: int) -> None:
    protocol = generic_protocol("held_out", ["a", "b"], np.arange(count, dtype=np.int64) * 3)
    assert protocol.shots
    for shots in protocol.shots:
        expected = 10 if shots.name == "short-video" else int(shots.name.split("-")[1])
        assert len(shots.frames) == expected
        assert len(shots.support) == 3
        assert set(shots.support) <= set(shots.frames)
        assert max(shots.frames) < min(protocol.evaluation_frames)
    assert len(protocol.evaluation_frames) <= 25


def test_generic_corner_cases() -> None:
    numbers = np.arange(700, dtype=np.int64)
    pretraining = generic_protocol("pretraining", ["a", "b"], numbers)
    assert pretraining.pretraining_frames == tuple(range(550))
    assert needed_pairs(pretraining) == {("a", frame) for frame in range(550)}
    assert generic_protocol("held_out", ["a"], numbers).evaluation_cameras == ("a",)
    assert generic_protocol("held_out", ["a"], numbers[:8]).shots == ()


def test_automatic_lists_stand_beside_the_official_ones(header: SequenceHeader) -> None:
    protocol = header.protocols[0]
    official = [shots for shots in protocol.shots if shots.list_name == "official"]
    auto = [shots for shots in protocol.shots if shots.list_name == "auto"]
    assert [s.name for s in auto] == [s.name for s in official] == ["fewshot-5"]
    assert len(auto[0].frames) == 5
    assert len(auto[0].support) == 3
    assert set(auto[0].support) <= set(auto[0].frames)
    assert min(official[0].frames) <= min(auto[0].frames)
    assert max(auto[0].frames) <= max(official[0].frames)
    again = with_automatic_lists(protocol, header.frames, header.fits, header.cameras[0])
    assert again == protocol


def _repeated(header: SequenceHeader, count: int) -> SequenceHeader:
    """The same fits over and over, as a longer sequence."""
    index = np.arange(count) % len(header.frames)
    fits = dataclasses.replace(
        header.fits,
        **{f.name: getattr(header.fits, f.name)[index] for f in dataclasses.fields(header.fits)},
    )
    return dataclasses.replace(header, frames=np.arange(count, dtype=np.int64), fits=fits)


def test_automatic_lists_use_usable_frames_of_the_pool_only(header: SequenceHeader) -> None:
    long = _repeated(header, 654)
    protocol = _zju("387")
    usable = np.ones(654, np.bool_)
    usable[::2] = False
    found = with_automatic_lists(protocol, long.frames, long.fits, long.cameras[0], usable)
    ten, clip = _list(found, "fewshot-10", "auto"), _list(found, "short-video", "auto")
    assert all(frame % 2 and frame <= 300 for frame in ten.frames)
    assert all(frame % 2 and 1 <= frame <= 100 for frame in clip.frames)
    assert len(ten.frames) == len(clip.frames) == 10
    assert len(_list(found, "fewshot-300", "auto").frames) == 150
    assert set(_list(found, "fewshot-5", "auto").frames) <= set(ten.frames)
    assert needed_pairs(found) == needed_pairs(protocol)
    usable[3:] = False
    found = with_automatic_lists(protocol, long.frames, long.fits, long.cameras[0], usable)
    assert {shots.list_name for shots in found.shots} == {"official"}


def test_pretraining_has_no_lists_to_choose(header: SequenceHeader) -> None:
    protocol = generic_protocol("pretraining", ["c01"], header.frames)
    found = with_automatic_lists(protocol, header.frames, header.fits, header.cameras[0])
    assert found == protocol
