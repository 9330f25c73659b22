"""The annotation files of AIST++: where they lie, and what they say, checked."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.pickles import load_pickle
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.aist_json import CameraEntry, read_camera_entries
from actorsnerf_preprocess.source import SourceError

JOINTS = 24
"""Rotations per frame, the root first."""


@dataclass(frozen=True)
class Motion:
    """The fit of one sequence as found: SMPL with zero betas, lengths in the world's unit."""

    poses: Float64
    """(N, 24, 3) axis-angle, the root first."""
    scaling: float
    """World units (about centimetres) per SMPL metre; one for the whole sequence."""
    translation: Float64
    """(N, 3) world units."""


def read_mapping(path: Path) -> dict[str, str]:
    """The camera setting of each sequence, from `mapping.txt`.

    Raises:
        SourceError: the file is missing or a line has not two columns.
    """
    settings: dict[str, str] = {}
    for number, line in enumerate(_text(path).splitlines(), start=1):
        columns = line.split()
        if not columns:
            continue
        if len(columns) != 2:
            raise SourceError(
                f"{path}, line {number}: {len(columns)} columns where a sequence and its camera"
                " setting were expected; the file is damaged: unpack the annotations again."
            )
        settings[columns[0]] = columns[1]
    return settings


def read_setting(cameras: Path, sequence: str) -> tuple[str, tuple[CameraEntry, ...]]:
    """The setting's name and its cameras, for one sequence.

    Raises:
        SourceError: the sequence is not mapped, or the setting's file is missing or wrong.
    """
    setting = read_mapping(cameras / "mapping.txt").get(sequence)
    if setting is None:
        raise SourceError(
            f"{cameras / 'mapping.txt'}: names no camera setting for {sequence}; the annotations"
            " are of another release than the motions, or the file is cut off."
        )
    return setting, read_camera_entries(cameras / f"{setting}.json")


def read_ignore_list(path: Path | None) -> frozenset[str]:
    """Sequences that the data set's authors ask to leave out; blanks around a name do not count."""
    if path is None:
        return frozenset()
    return frozenset(name for line in _text(path).splitlines() if (name := line.strip()))


def read_motion(path: Path) -> Motion:
    """The SMPL fit of a sequence.

    Raises:
        SourceError: the pickle is missing, unsafe, or lacks an entry; shapes do not agree; a
            number is not finite.
    """
    entries = _entries(path)
    poses = _numbers(path, entries, "smpl_poses")
    scaling = _numbers(path, entries, "smpl_scaling")
    translation = _numbers(path, entries, "smpl_trans")
    if poses.ndim == 2 and poses.shape[1] == 3 * JOINTS:
        poses = poses.reshape(-1, JOINTS, 3)
    if poses.ndim != 3 or poses.shape[1:] != (JOINTS, 3):
        raise SourceError(
            f"{path}, smpl_poses: shape {poses.shape}, expected (frames, 72) or (frames, 24, 3)."
        )
    if translation.shape != (len(poses), 3):
        raise SourceError(
            f"{path}, smpl_trans: shape {translation.shape}, expected ({len(poses)}, 3) as there"
            f" are {len(poses)} poses."
        )
    if scaling.size != 1 or not scaling.reshape(()) > 0:
        raise SourceError(f"{path}, smpl_scaling: expected one positive number, found {scaling}.")
    return Motion(poses, float(scaling.reshape(())), translation)


def read_keypoints(path: Path, key: str, dimensions: int) -> Float64:
    """An optional keypoint array, joints and coordinates last; NaN where nobody was seen.

    Raises:
        SourceError: the entry is missing or has other axes.
    """
    value = _numbers(path, _entries(path), key, finite=False)
    if value.ndim < 3 or value.shape[-2:] != (17, dimensions):
        raise SourceError(
            f"{path}, {key}: shape {value.shape}, expected (..., 17, {dimensions}) of COCO joints."
        )
    return value


def _entries(path: Path) -> dict[str, object]:
    if not path.is_file():
        raise SourceError(f"{path}: there is no such file; unpack the annotations again.")
    try:
        content = load_pickle(path)
    except OSError as error:
        raise SourceError(f"{path}: cannot be read ({error.strerror}).") from error
    if not isinstance(content, dict):
        raise SourceError(f"{path}: holds a {type(content).__name__}, expected a dictionary.")
    return {str(key): value for key, value in content.items()}


def _numbers(path: Path, entries: dict[str, object], key: str, *, finite: bool = True) -> Float64:
    if key not in entries:
        raise SourceError(
            f"{path}: has no entry {key} (found {', '.join(sorted(entries))}); it is not a file of"
            " the AIST++ annotations, or of a reduced copy: download the original."
        )
    try:
        value = np.asarray(entries[key], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SourceError(f"{path}, {key}: is no array of numbers.") from error
    if finite and not np.isfinite(value).all():
        bad = int((~np.isfinite(value)).sum())
        raise SourceError(f"{path}, {key}: {bad} of {value.size} numbers are not finite.")
    return value


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise SourceError(
            f"{path}: there is no such file; unpack the annotations again."
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(f"{path}: cannot be read as text ({error}).") from error
