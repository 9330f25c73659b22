from dataclasses import replace
from pathlib import Path
from typing import Protocol

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_train.places import few_places, find_places, spread


class People(Protocol):
    eve: Path


@pytest.fixture
def file(people: People) -> SequenceFile:
    return SequenceFile(people.eve)


def test_pictures_are_found_camera_by_camera(file: SequenceFile) -> None:
    (protocol,) = file.header.protocols
    numbers = protocol.evaluation_frames[:2]
    first, second = (file.frame_index(number) for number in numbers)
    found = find_places(file, protocol, numbers, ("camera1", "camera0"))
    assert found.pairs == ((1, first), (1, second), (0, first), (0, second))
    assert found.missing == ()


def test_invalid_pictures_are_missing_and_none_left_is_refused(file: SequenceFile) -> None:
    (protocol,) = file.header.protocols
    numbers = protocol.evaluation_frames[:2]
    valid = file.valid.copy()
    valid[1, file.frame_index(numbers[0])] = False
    file.__dict__["valid"] = valid  # as the reader keeps it
    assert find_places(file, protocol, numbers, ("camera1",)).missing == (("camera1", numbers[0]),)
    with pytest.raises(UserError, match="none of the 1 evaluation frames x 1 cameras of protocol"):
        find_places(file, protocol, numbers[:1], ("camera1",))


def test_few_are_spread_over_frames_and_cameras(file: SequenceFile) -> None:
    (protocol,) = file.header.protocols
    both = replace(protocol, evaluation_cameras=("camera0", "camera1"))
    frames = [file.frame_index(number) for number in protocol.evaluation_frames]
    assert len(frames) > 4
    chosen = few_places(file, both, 4)
    assert [camera for camera, _ in chosen] == [0, 1, 0, 1]
    expected = [frames[round(i * (len(frames) - 1) / 3)] for i in range(4)]
    assert [frame for _, frame in chosen] == expected


def test_few_of_fewer_are_each_once(file: SequenceFile) -> None:
    (protocol,) = file.header.protocols
    small = replace(
        protocol,
        evaluation_frames=protocol.evaluation_frames[:2],
        evaluation_cameras=("camera0", "camera1"),
    )
    chosen = few_places(file, small, 6)
    assert len(chosen) == len(set(chosen)) >= 3
    one = replace(small, evaluation_frames=small.evaluation_frames[:1])
    assert len(few_places(file, one, 6)) == 2


def test_spreading_keeps_both_ends() -> None:
    assert spread(range(10), 4) == [0, 3, 6, 9]
    assert spread(range(3), None) == spread(range(3), 7) == [0, 1, 2]
    assert spread(range(3), 1) == [0]
