"""The cameras of an AIST++ setting, from its json file, checked."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.source import SourceError


@dataclass(frozen=True)
class CameraEntry:
    """One calibrated view as found; lengths in the world's unit (about centimetres)."""

    name: str
    index: int
    """Position in the file."""
    size: tuple[int, int]
    """Width, height of the calibrated picture."""
    K: Float64
    R: Float64
    """(3, 3) camera from world."""
    translation: Float64
    """(3,) camera from world, world units."""
    distortion: Float64
    """(5,) OpenCV order."""


def read_camera_entries(path: Path) -> tuple[CameraEntry, ...]:
    """The cameras of a setting in the order of the file.

    Raises:
        SourceError: the file is missing or no json, or a camera lacks an entry, has wrong shapes,
            numbers that are not finite, or a focal length that is not positive.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise SourceError(
            f"{path}: there is no such camera setting; unpack cameras/ again."
        ) from error
    except (OSError, ValueError) as error:
        raise SourceError(f"{path}: cannot be read as json ({error}).") from error
    if not isinstance(content, list) or not content:
        raise SourceError(f"{path}: expected a list of cameras, found {type(content).__name__}.")
    cameras = tuple(_entry(path, index, item) for index, item in enumerate(content))
    names = [camera.name for camera in cameras]
    if len(set(names)) != len(names):
        raise SourceError(f"{path}: two cameras share a name ({', '.join(names)}).")
    return cameras


def _entry(path: Path, index: int, item: object) -> CameraEntry:
    if not isinstance(item, dict) or "name" not in item:
        raise SourceError(f"{path}, camera {index}: expected a dictionary with a name.")
    where = f"{path}, camera {item['name']}"
    K = _array(where, item, "matrix", (3, 3))
    rotation = _array(where, item, "rotation", (3,))
    size = _array(where, item, "size", (2,))
    found = _array(where, item, "distortions", None)
    if found.size > 5:
        raise SourceError(f"{where}, distortions: {found.size} numbers, expected at most 5.")
    distortion = np.zeros(5)
    distortion[: found.size] = found
    width, height = int(size[0]), int(size[1])
    if K[0, 0] <= 0 or K[1, 1] <= 0 or not (0 < K[0, 2] < width and 0 < K[1, 2] < height):
        raise SourceError(
            f"{where}, matrix: focal lengths {K[0, 0]:g}, {K[1, 1]:g} and centre {K[0, 2]:g},"
            f" {K[1, 2]:g} do not belong to a {width} x {height} picture."
        )
    return CameraEntry(
        name=str(item["name"]),
        index=index,
        size=(width, height),
        K=K,
        R=matrix_from_axis_angle(rotation),
        translation=_array(where, item, "translation", (3,)),
        distortion=distortion,
    )


def _array(where: str, item: dict[str, object], key: str, shape: tuple[int, ...] | None) -> Float64:
    if key not in item:
        raise SourceError(f"{where}: has no entry {key}.")
    try:
        value = np.asarray(item[key], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SourceError(f"{where}, {key}: is no array of numbers.") from error
    if shape is None:
        value = value.reshape(-1)
    elif value.size == int(np.prod(shape)):
        value = value.reshape(shape)
    else:
        raise SourceError(f"{where}, {key}: shape {value.shape}, expected {shape}.")
    if not np.isfinite(value).all():
        raise SourceError(f"{where}, {key}: holds a number that is not finite.")
    return value
