"""Which camera, frames and lists of a prepared file are meant; or a sentence on why none are."""

from collections.abc import Sequence
from dataclasses import dataclass

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import ListName, Protocol, Shots


@dataclass(frozen=True)
class FewshotChoice:
    """Which few-shot setting of a file."""

    setting: str = "fewshot-10"
    """fewshot-5, fewshot-10, fewshot-30, fewshot-100, fewshot-300 or short-video."""
    list_name: ListName | None = None
    """Official or automatic list; None = the official one where the file has it."""
    protocol: str | None = None
    """None = the file's only protocol."""
    k: int = 3
    """Support views; fewer than the list has takes its first."""


def camera_index(sequence: SequenceFile, camera: str | int) -> int:
    """The position of a camera given by name, or by position.

    Raises:
        UserError: the file has no such camera.
    """
    if isinstance(camera, str):
        return sequence.camera_index(camera)
    count = len(sequence.header.cameras)
    if 0 <= camera < count:
        return camera
    raise UserError(f"{sequence.path}: has no camera at position {camera}; it has {count}.")


def usable(sequence: SequenceFile, camera: int, frames: Sequence[int], what: str) -> None:
    """Refuse frame numbers without a valid picture at a camera.

    Args:
        sequence: prepared file.
        camera: position of the camera.
        frames: frame numbers.
        what: names them in the message.

    Raises:
        UserError: a picture is not stored, or is marked invalid.
    """
    bad = [n for n in frames if not sequence.valid[camera, sequence.frame_index(n)]]
    if bad:
        stored = sequence.row[camera, sequence.frame_index(bad[0])] >= 0
        why = (
            "the preparation found no usable fit or mask (see its report)"
            if stored
            else "it is not stored: either it could not be, then the preparation's report "
            f"{sequence.path.with_suffix('.json').name} says why, or it was not asked for, then "
            "prepare again with --all-pairs"
        )
        raise UserError(
            f"{sequence.path}: camera {sequence.header.cameras[camera].name} has no valid picture "
            f"of {len(bad)} of the {len(frames)} {what}, first of frame {bad[0]}: {why}."
        )


def find_protocol(sequence: SequenceFile, name: str | None) -> Protocol:
    """The protocol of a name, or the file's only one.

    Raises:
        UserError: there is none, or several and no name.
    """
    protocols = sequence.header.protocols
    names = [protocol.name for protocol in protocols]
    if name is None and len(protocols) == 1:
        return protocols[0]
    if name is None:
        raise UserError(
            f"{sequence.path}: has {len(names)} protocols ({', '.join(names) or 'none'}): name one "
            "of them."
        )
    if name not in names:
        raise UserError(
            f"{sequence.path}: has no protocol {name!r}; it has {', '.join(names) or 'none'}."
        )
    return protocols[names.index(name)]


def pretraining_protocol(sequence: SequenceFile) -> Protocol:
    """The first protocol of a file that may be pre-trained on.

    Raises:
        UserError: the actor is held out in a protocol of the file, or it has none.
    """
    header = sequence.header
    for protocol in header.protocols:
        if protocol.role == "held_out":
            raise UserError(
                f"{sequence.path}: actor {header.actor} is held out for testing in protocol "
                f"{protocol.name}; pre-training on it would leak the test: leave the file out."
            )
    if not header.protocols:
        raise UserError(f"{sequence.path}: has no protocol, so no pre-training frames.")
    return header.protocols[0]


def find_shots(sequence: SequenceFile, protocol: Protocol, choice: FewshotChoice) -> Shots:
    """The frames and the first K supports of a few-shot setting.

    Raises:
        UserError: the actor is for pre-training, the setting is not there, or it has fewer frames
            or supports than K.
    """
    header = sequence.header
    if protocol.role != "held_out":
        raise UserError(
            f"{sequence.path}: actor {header.actor} has the role {protocol.role} in protocol "
            f"{protocol.name}; few-shot training is for held_out actors: prepare it with "
            "--held-out, and pre-train without it."
        )
    lists = [shots for shots in protocol.shots if shots.name == choice.setting]
    order = ("official", "auto") if choice.list_name is None else (choice.list_name,)
    for name in order:
        for shots in lists:
            if shots.list_name == name:
                return _first_supports(sequence, shots, choice.k)
    there = [f"{shots.name} ({shots.list_name})" for shots in protocol.shots]
    wanted = choice.setting + (f" ({choice.list_name})" if choice.list_name else "")
    raise UserError(
        f"{sequence.path}: protocol {protocol.name} has no setting {wanted} for actor "
        f"{header.actor}; it has {', '.join(there) or 'none'}."
    )


def _first_supports(sequence: SequenceFile, shots: Shots, k: int) -> Shots:
    if k > len(shots.frames):
        raise UserError(
            f"{sequence.path}: {shots.name} has {len(shots.frames)} frames, fewer than the {k} "
            "supports asked for (K > M): take fewer supports or more shots."
        )
    if k > len(shots.support):
        raise UserError(
            f"{sequence.path}: the {shots.list_name} list of {shots.name} names "
            f"{len(shots.support)} supports, but {k} are asked for: take K = {len(shots.support)}."
        )
    return Shots(shots.name, shots.list_name, shots.frames, shots.support[:k])
