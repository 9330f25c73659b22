"""Motion files of others: AIST++ pickles and AMASS-style npz in, poses in one convention out.

The convention is checked, not guessed: what is neither is refused with the sign that gave it away.
Only poses and root motion are taken; a foreign motion brings no shape.
"""

import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.conventions import metres_from_aist
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.pickles import load_pickle
from actorsnerf_datasets.types import Float64

LARGEST_ANGLE = 4 * math.pi
"""Length of an axis-angle vector that only degrees reach (fits wander to 2 pi, not beyond 4)."""
FARTHEST = 100.0
"""Metres from the origin that only another unit reaches."""
_ACCEPTED = (
    "expected AIST++ (.pkl with smpl_poses, smpl_scaling, smpl_trans) or AMASS style (.npz with "
    "poses and trans)"
)


class PoseFileError(UserError):
    """A motion file is missing, or of another convention."""


@dataclass(frozen=True)
class PoseSequence:
    """A motion of T frames, standard SMPL convention: v = R (x - j0) + j0 + transl."""

    global_orient: Float64
    """(T, 3) axis-angle about the pelvis, radians."""
    body_pose: Float64
    """(T, 23, 3) axis-angle of joints 1 to 23."""
    transl: Float64
    """(T, 3) metres."""
    up: Float64
    """(3,) which way is up in the file's world: y for AIST++, z for AMASS."""
    fps: float | None


def load_poses(path: Path) -> PoseSequence:
    """The motion in a file.

    AIST++: 72 numbers a frame, translation in centimetres of the scaled body, 60 frames a second,
    y up. AMASS: 72 (SMPL), 156 (SMPL-H) or 165 (SMPL-X) numbers, metres, z up; of the latter two
    the first 22 joints are SMPL's own and SMPL's two hand joints stay straight.

    Raises:
        PoseFileError: no such file, or of another convention.
    """
    if not path.is_file():
        raise PoseFileError(f"{path}: no such pose file; {_ACCEPTED}.")
    match path.suffix:
        case ".pkl" | ".pickle":
            return _from_aist(path, _mapping(path, load_pickle(path)))
        case ".npz":
            return _from_amass(path, _npz(path))
        case other:
            raise PoseFileError(f"{path}: is a {other or 'file without suffix'}; {_ACCEPTED}.")


def _from_aist(path: Path, entries: Mapping[str, object]) -> PoseSequence:
    _refuse_easymocap(path, entries)
    poses = _poses(path, "smpl_poses", entries)
    scaling = _numbers(path, "smpl_scaling", entries).reshape(-1)
    if scaling.size != 1 or not scaling[0] > 0:
        raise PoseFileError(
            f"{path}: smpl_scaling is {scaling.tolist()}, expected one positive number (about 100)."
        )
    translation = _translation(path, "smpl_trans", entries, len(poses))
    return PoseSequence(
        global_orient=poses[:, 0],
        body_pose=poses[:, 1:],
        transl=_plausible(path, "smpl_trans", metres_from_aist(translation, float(scaling[0]))),
        up=np.array([0.0, 1.0, 0.0]),
        fps=60.0,
    )


def _from_amass(path: Path, entries: Mapping[str, object]) -> PoseSequence:
    _refuse_easymocap(path, entries)
    poses = _poses(path, "poses", entries)
    translation = _translation(path, "trans", entries, len(poses))
    rate = next((k for k in ("mocap_framerate", "mocap_frame_rate") if k in entries), None)
    return PoseSequence(
        global_orient=poses[:, 0],
        body_pose=poses[:, 1:],
        transl=_plausible(path, "trans", translation),
        up=np.array([0.0, 0.0, 1.0]),
        fps=None if rate is None else float(_numbers(path, rate, entries).reshape(-1)[0]),
    )


def _poses(path: Path, name: str, entries: Mapping[str, object]) -> Float64:
    """Axis-angles (T, 24, 3) after every check that needs no other entry."""
    found = _numbers(path, name, entries)
    if found.ndim < 2 or len(found) == 0:
        raise PoseFileError(f"{path}: {name} has shape {found.shape}, expected (frames, 72).")
    _refuse_other_rotations(path, name, found)
    flat = found.reshape(len(found), -1)
    if flat.shape[1] in (156, 165):  # SMPL-H, SMPL-X: 22 shared joints, then face and fingers
        flat = np.concatenate([flat[:, :66], np.zeros((len(flat), 6))], axis=1)
    if flat.shape[1] != 72:
        raise PoseFileError(
            f"{path}: {name} has {flat.shape[1]} numbers a frame, expected 72 (SMPL), 156 (SMPL-H) "
            "or 165 (SMPL-X), root rotation included."
        )
    poses = flat.reshape(-1, 24, 3)
    bad = np.flatnonzero(~np.isfinite(poses).all(axis=(1, 2)))
    if len(bad):
        raise PoseFileError(
            f"{path}: {name} is not finite in {len(bad)} frames, first at position {bad[0]}: "
            "cut them out."
        )
    longest = float(np.linalg.norm(poses, axis=2).max())
    if longest > LARGEST_ANGLE:
        raise PoseFileError(
            f"{path}: {name} has a rotation by {longest:.1f}, which cannot be radians: are these "
            "degrees? Convert them to radians."
        )
    return poses


def _refuse_other_rotations(path: Path, name: str, found: Float64) -> None:
    numbers = int(np.prod(found.shape[1:]))
    if numbers == 69:
        raise PoseFileError(
            f"{path}: {name} has 69 numbers a frame: the root rotation is missing; expected 72."
        )
    if (found.shape[-2:] == (3, 3) and found.ndim >= 4) or numbers == 216:
        raise PoseFileError(
            f"{path}: {name} has shape {found.shape}: rotation matrices, expected axis-angle "
            "vectors (frames, 72)."
        )
    if (found.shape[-1] == 4 and found.ndim == 3) or numbers == 96:
        raise PoseFileError(
            f"{path}: {name} has shape {found.shape}: quaternions, expected axis-angle vectors "
            "(frames, 72)."
        )


def _refuse_easymocap(path: Path, entries: Mapping[str, object]) -> None:
    if "Rh" in entries or "Th" in entries:
        raise PoseFileError(
            f"{path}: has Rh and Th: EasyMocap's convention, which turns about another point; "
            "prepare the sequence (python -m actorsnerf_preprocess prepare --help) and render "
            "with --motion sequence."
        )


def _translation(path: Path, name: str, entries: Mapping[str, object], frames: int) -> Float64:
    found = _numbers(path, name, entries)
    if found.shape != (frames, 3):
        raise PoseFileError(
            f"{path}: {name} has shape {found.shape}, expected ({frames}, 3) as there are "
            f"{frames} poses."
        )
    return found


def _plausible(path: Path, name: str, metres: Float64) -> Float64:
    if not np.isfinite(metres).all():
        raise PoseFileError(f"{path}: {name} is not finite.")
    farthest = float(np.abs(metres).max())
    if farthest > FARTHEST:
        raise PoseFileError(
            f"{path}: {name} puts the body {farthest:.0f} m from the origin: is it in another "
            "unit? Expected metres (AMASS) or scaled centimetres (AIST++)."
        )
    return metres


def _numbers(path: Path, name: str, entries: Mapping[str, object]) -> Float64:
    if name not in entries:
        raise PoseFileError(
            f"{path}: has no {name}, only {', '.join(sorted(entries)) or 'nothing'}; {_ACCEPTED}."
        )
    try:
        return np.asarray(entries[name], dtype=np.float64)
    except (TypeError, ValueError):
        raise PoseFileError(f"{path}: {name} is not an array of numbers; {_ACCEPTED}.") from None


def _mapping(path: Path, found: object) -> Mapping[str, object]:
    if not isinstance(found, Mapping):
        raise PoseFileError(f"{path}: holds a {type(found).__name__}, not a table; {_ACCEPTED}.")
    return {str(name): value for name, value in found.items()}


def _npz(path: Path) -> Mapping[str, object]:
    wanted = ("poses", "trans", "mocap_framerate", "mocap_frame_rate", "Rh", "Th")
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            return {n: archive[n] if n in wanted else None for n in archive.files}
    except (zipfile.BadZipFile, ValueError, OSError, EOFError, TypeError) as error:
        raise PoseFileError(f"{path}: cannot be read as npz ({error}): damaged file?") from None
