"""`annots.npy` of the ZJU-MoCap family as checked arrays: cameras, and picture paths per frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.pickles import load_npy
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.source import Finding, SourceError

MILLIMETRE_DISTANCE = 1000.0
"""A median camera distance from the world's origin above this can only be millimetres: cameras that
see a whole person stand a metre away or more. Released archives have 3000 to 3900."""
METRE_DISTANCE = 20.0
"""One below this can only be metres."""
ROTATION_TOLERANCE = 1e-4
LEAST_AGREEMENT = 0.1
"""Length of the mean of the cameras' image-down directions; 1 if all agree."""


@dataclass(frozen=True)
class Annotations:
    """What `annots.npy` says, in metres."""

    K: Float64
    """(C, 3, 3)."""
    distortion: Float64
    """(C, 5)."""
    R: Float64
    """(C, 3, 3) camera from world."""
    T: Float64
    """(C, 3) metres."""
    pictures: tuple[tuple[str, ...], ...]
    """Per frame, per camera: path below the sequence's folder, with `/`; empty if not listed."""
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]


def read_annotations(path: Path) -> Annotations:
    """The cameras and picture paths of an `annots.npy`, checked and in metres.

    Args:
        path: `annots.npy` or `annots_new.npy`.

    Raises:
        SourceError: the file is not such a dictionary, or its cameras cannot be right.
    """
    content = load_npy(path)
    if isinstance(content, np.ndarray) and content.shape == ():
        content = content.item()
    if not isinstance(content, Mapping) or not isinstance(content.get("cams"), Mapping):
        raise SourceError(
            f"{path}: expected a dictionary with 'cams' (K, D, R, T) and 'ims', found "
            f"{_kind(content)}: is this the annots.npy of a ZJU-MoCap sequence?"
        )
    K, distortion, R, T = _camera_arrays(path, content["cams"])
    _check_cameras(path, K, R)
    T, unit_note = _in_metres(path, R, T)
    pictures, picture_findings = _pictures(path, content.get("ims"), len(K))
    notes = [unit_note]
    findings = list(picture_findings)
    if any("\\" in name for frame in pictures for name in frame):
        pictures = tuple(tuple(name.replace("\\", "/") for name in frame) for frame in pictures)
        notes.append("Backslashes in the picture paths of annots.npy were read as slashes.")
    if not np.any(distortion):
        findings.append(
            Finding(
                "note", f"{path.name}/cams/D", "All zero: the pictures are undistorted already."
            )
        )
    return Annotations(K, distortion, R, T, pictures, tuple(findings), tuple(notes))


def world_up(R: Float64) -> Float64:
    """The direction against gravity (3,): minus the mean of the cameras' image-down directions.

    ZJU-MoCap's z axis points down; cameras stand upright on average, so the second rows of R say
    so for any sequence without being told.

    Raises:
        SourceError: the directions cancel out.
    """
    down: Float64 = R[:, 1].mean(axis=0)
    length = float(np.linalg.norm(down))
    if length < LEAST_AGREEMENT:
        raise SourceError(
            "The cameras' image-down directions cancel out, so up is unknown: do some of the "
            "cameras stand upside down?"
        )
    return -down / length


def _camera_arrays(
    path: Path, cams: Mapping[str, object]
) -> tuple[Float64, Float64, Float64, Float64]:
    missing = [key for key in ("K", "D", "R", "T") if key not in cams]
    if missing:
        raise SourceError(f"{path}: 'cams' has no {', '.join(missing)}, expected K, D, R and T.")
    counts = {key: len(_sequence(path, key, cams[key])) for key in ("K", "D", "R", "T")}
    if len(set(counts.values())) != 1 or not counts["K"]:
        raise SourceError(f"{path}: 'cams' lists different numbers of cameras: {counts}.")
    count = counts["K"]
    return (
        _numbers(path, "K", cams["K"], (count, 3, 3)),
        _distortions(path, cams["D"], count),
        _numbers(path, "R", cams["R"], (count, 3, 3)),
        _numbers(path, "T", cams["T"], (count, 3)),
    )


def _sequence(path: Path, key: str, values: object) -> Sequence[object]:
    if isinstance(values, np.ndarray):
        return list(values)
    if isinstance(values, list | tuple):
        return values
    raise SourceError(f"{path}: cams/{key} is {_kind(values)}, expected a list of arrays.")


def _numbers(path: Path, key: str, values: object, shape: tuple[int, ...]) -> Float64:
    try:
        rows = [np.asarray(value, np.float64) for value in _sequence(path, key, values)]
        array = np.stack([row.reshape(shape[1:]) for row in rows])
    except (TypeError, ValueError) as error:
        raise SourceError(
            f"{path}: cams/{key} does not hold numbers of shape {shape[1:]} per camera ({error})."
        ) from error
    bad = np.flatnonzero(~np.isfinite(array.reshape(len(array), -1)).all(axis=1))
    if bad.size:
        raise SourceError(f"{path}: cams/{key} of camera index {bad[0]} is not finite.")
    return array


def _distortions(path: Path, values: object, count: int) -> Float64:
    """(C, 5); four numbers (without k3) are padded, column or row vectors alike."""
    rows = [np.asarray(value, np.float64).ravel() for value in _sequence(path, "D", values)]
    if any(row.size not in (4, 5) for row in rows):
        sizes = sorted({row.size for row in rows})
        raise SourceError(f"{path}: cams/D has {sizes} numbers per camera, expected 5 (or 4).")
    padded = [np.pad(row, (0, 5 - row.size)) for row in rows]
    return _numbers(path, "D", padded, (count, 5))


def _check_cameras(path: Path, K: Float64, R: Float64) -> None:
    deviation = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    if deviation.max() > ROTATION_TOLERANCE:
        camera = int(deviation.argmax())
        raise SourceError(
            f"{path}: cams/R of camera index {camera} is not a rotation: R R^T differs from the "
            f"identity by {deviation[camera]:.2g}."
        )
    determinant = np.linalg.det(R)
    if determinant.min() < 0:
        camera = int(determinant.argmin())
        raise SourceError(
            f"{path}: cams/R of camera index {camera} is left-handed (determinant -1), expected a "
            "rotation from world to an OpenCV camera: was an axis flipped when it was exported?"
        )
    focal = K[:, [0, 1], [0, 1]]
    if focal.min() <= 0:
        camera = int(focal.min(axis=1).argmin())
        raise SourceError(
            f"{path}: cams/K of camera index {camera} has focal lengths {focal[camera].tolist()}, "
            "expected positive pixels."
        )


def _in_metres(path: Path, R: Float64, T: Float64) -> tuple[Float64, str]:
    """Translations in metres and the sentence that says how the unit was decided."""
    centres = np.einsum("cij,ci->cj", R, T)
    distance = float(np.median(np.linalg.norm(centres, axis=1)))
    if distance > MILLIMETRE_DISTANCE:
        return T / 1000.0, (
            f"Camera translations are millimetres (median distance {distance:.0f} from the world's "
            "origin) and were divided by 1000."
        )
    if distance < METRE_DISTANCE:
        return T, (
            f"Camera translations are metres already (median distance {distance:.2f} from the "
            "world's origin); the released archives have millimetres."
        )
    raise SourceError(
        f"{path}: cameras are {distance:.3g} units from the world's origin at the median, which is "
        f"neither millimetres (more than {MILLIMETRE_DISTANCE:.0f}) nor metres (less than "
        f"{METRE_DISTANCE:.0f}): are they centimetres?"
    )


def _pictures(
    path: Path, ims: object, cameras: int
) -> tuple[tuple[tuple[str, ...], ...], list[Finding]]:
    if ims is None or not len(_sequence(path, "ims", ims)):
        return (), [Finding("note", f"{path.name}/ims", "Holds no picture paths.")]
    frames = []
    for position, entry in enumerate(_sequence(path, "ims", ims)):
        names = entry.get("ims") if isinstance(entry, Mapping) else None
        if not isinstance(names, list | tuple | np.ndarray):
            raise SourceError(
                f"{path}: ims[{position}] has no list 'ims' of picture paths, found {_kind(entry)}."
            )
        if len(names) != cameras:
            raise SourceError(
                f"{path}: ims[{position}] lists {len(names)} pictures, but 'cams' has {cameras} "
                "cameras."
            )
        frames.append(tuple(str(name) for name in names))
    return tuple(frames), []


def _kind(value: object) -> str:
    if isinstance(value, Mapping):
        return f"a dictionary with {sorted(map(str, value))[:8]}"
    return f"a {type(value).__name__}"
