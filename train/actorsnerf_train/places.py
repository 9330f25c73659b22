"""Which pictures of a protocol's evaluation a file holds."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.selection import camera_index
from actorsnerf_datasets.types import Protocol

Item = TypeVar("Item")


@dataclass(frozen=True)
class Places:
    """Pictures of some evaluation frames and cameras."""

    pairs: tuple[tuple[int, int], ...]
    """(camera, frame) positions with a valid picture; all frames of the first camera first."""
    missing: tuple[tuple[str, int], ...]
    """(camera, frame number) without."""


def find_places(
    file: SequenceFile, protocol: Protocol, frames: Sequence[int], cameras: Sequence[str]
) -> Places:
    """The pictures of some of a protocol's evaluation frames (numbers) and cameras (names).

    Raises:
        UserError: not one of them is valid.
    """
    pairs: list[tuple[int, int]] = []
    missing: list[tuple[str, int]] = []
    for name in cameras:
        camera = camera_index(file, name)
        for number in frames:
            frame = file.frame_index(number)
            if file.valid[camera, frame]:
                pairs.append((camera, frame))
            else:
                missing.append((name, number))
    if not pairs:
        raise UserError(
            f"{file.path}: none of the {len(frames)} evaluation frames x {len(cameras)} cameras of "
            f"protocol {protocol.name} has a valid picture: was the file prepared for it?"
        )
    return Places(tuple(pairs), tuple(missing))


def few_places(file: SequenceFile, protocol: Protocol, most: int) -> tuple[tuple[int, int], ...]:
    """At most so many valid pictures of a protocol, spread over its frames and its cameras alike.

    A function of file and protocol alone: the i-th is of the i-th of so many evenly spread frames,
    and of the next camera in turn that has a picture of it.

    Raises:
        UserError: the protocol has no valid picture.
    """
    pairs = find_places(file, protocol, protocol.evaluation_frames, protocol.evaluation_cameras)
    frames = sorted({frame for _, frame in pairs.pairs})
    chosen: list[tuple[int, int]] = []
    for i in range(min(most, len(pairs.pairs))):
        frame = frames[round(i * (len(frames) - 1) / max(most - 1, 1))]
        cameras = [c for c, f in pairs.pairs if f == frame and (c, f) not in chosen]
        if cameras:
            chosen.append((cameras[i % len(cameras)], frame))
    return tuple(chosen)


def spread(items: Sequence[Item], most: int | None) -> list[Item]:
    """At most so many of the items, evenly spread, the first and the last among them.

    >>> spread("abcdefg", 3)
    ['a', 'd', 'g']
    """
    if most is None or most >= len(items):
        return list(items)
    if most == 1:
        return [items[0]]
    return [items[round(i * (len(items) - 1) / (most - 1))] for i in range(most)]
