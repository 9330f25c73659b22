"""A protocol's frame lists without the frames whose picture turned out unusable, said aloud."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Protocol, Shots


def usable_protocol(
    protocol: Protocol, usable: set[tuple[str, int]]
) -> tuple[Protocol, tuple[str, ...]]:
    """The protocol that the prepared pictures can serve, and a sentence per list that changed.

    A training list loses the frames without a usable picture of the training camera; a few-shot
    list that loses a support frame is left out; an evaluation frame goes when no evaluation camera
    has it.

    Args:
        protocol: as published or chosen.
        usable: (camera name, frame number) pairs with a usable picture.
    """
    notes: list[str] = []
    camera = protocol.training_camera
    training = _kept(protocol.pretraining_frames, {f for c, f in usable if c == camera})
    _note(notes, "pre-training frames", protocol.pretraining_frames, training)
    seen = {f for c, f in usable if c in protocol.evaluation_cameras}
    evaluation = _kept(protocol.evaluation_frames, seen)
    _note(notes, "evaluation frames", protocol.evaluation_frames, evaluation)
    shots = []
    for one in protocol.shots:
        kept = _usable_shots(one, {f for c, f in usable if c == camera})
        if kept is None:
            notes.append(f"{one.name} ({one.list_name}) is left out: a support frame is unusable.")
            continue
        _note(notes, f"frames of {one.name} ({one.list_name})", one.frames, kept.frames)
        shots.append(kept)
    changed = replace(
        protocol,
        pretraining_frames=training,
        evaluation_frames=evaluation,
        shots=tuple(shots),
    )
    return changed, tuple(notes)


def usable_pairs(
    cameras: Sequence[str], frames: NDArray[np.int64], usable: NDArray[np.bool_]
) -> set[tuple[str, int]]:
    """(camera name, frame number) of the true entries of a (C, F) table.

    >>> usable_pairs(["a"], np.array([7, 9]), np.array([[False, True]]))
    {('a', 9)}
    """
    return {(cameras[c], int(frames[f])) for c, f in np.argwhere(usable)}


def _usable_shots(shots: Shots, usable: set[int]) -> Shots | None:
    if not set(shots.support) <= usable:
        return None
    return replace(shots, frames=_kept(shots.frames, usable))


def _kept(frames: tuple[int, ...], usable: set[int]) -> tuple[int, ...]:
    return tuple(frame for frame in frames if frame in usable)


def _note(notes: list[str], what: str, before: tuple[int, ...], after: tuple[int, ...]) -> None:
    lost = sorted(set(before) - set(after))
    if lost:
        shown = ", ".join(map(str, lost[:5])) + (", ..." if len(lost) > 5 else "")
        notes.append(f"{len(lost)} of {len(before)} {what} are unusable and left out: {shown}.")
