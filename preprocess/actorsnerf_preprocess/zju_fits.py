"""SMPL fits of a ZJU-MoCap tree as their files have them, and the vertices rebuilt from them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets import types
from actorsnerf_datasets.body_model import BodyModel, pose, rest
from actorsnerf_datasets.conventions import folded_root, standard_from_easymocap, world_from_body
from actorsnerf_datasets.pickles import load_npy
from actorsnerf_preprocess.source import SourceError


@dataclass(frozen=True)
class RawFit:
    """One parameter file, EasyMocap's convention: v = R(Rh) x + Th."""

    pose: types.Float64
    """(24, 3); the root is as found."""
    Rh: types.Float64
    Th: types.Float64
    betas: types.Float64
    padded: bool
    """The file had 69 numbers, without the root."""


def fit_file(folder: Path, frame: int) -> Path | None:
    """The file of a frame in a folder of parameters or vertices: `7.npy` or `000007.npy`."""
    for name in (f"{frame}.npy", f"{frame:06d}.npy"):
        if (folder / name).is_file():
            return folder / name
    return None


def read_fit(path: Path) -> RawFit:
    """The numbers of one parameter file.

    Raises:
        SourceError: an entry is missing, has another length, or is not finite.
    """
    content = load_npy(path)
    if not isinstance(content, Mapping):
        raise SourceError(f"{path}: expected a dictionary with poses, Rh, Th and shapes.")
    poses = _vector(path, content, "poses", (72, 69))
    padded = poses.size == 69
    if padded:
        poses = np.concatenate((np.zeros(3), poses))
    return RawFit(
        pose=poses.reshape(24, 3),
        Rh=_vector(path, content, "Rh", (3,)),
        Th=_vector(path, content, "Th", (3,)),
        betas=_vector(path, content, "shapes", (10,)),
        padded=padded,
    )


def world_vertices(fit: RawFit, model: BodyModel, pose_blend: bool) -> types.Float64:
    """The vertices (V, 3) of a fit rebuilt with the body model, world, metres."""
    standard = standard_transform(fit, model)
    posed = pose(model, fit.betas, pose_without_root(fit), pose_blend)
    matrix = world_from_body(*standard, posed.rest_joints[0])
    vertices: types.Float64 = posed.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return vertices


def standard_transform(fit: RawFit, model: BodyModel) -> tuple[types.Float64, types.Float64]:
    """Global orientation and translation in the standard convention, the root folded in."""
    pelvis = rest(model, fit.betas)[0][0]
    Rh, Th = fit.Rh, fit.Th
    if np.any(fit.pose[0]):
        Rh, Th = folded_root(Rh, Th, fit.pose[0], pelvis)
    return standard_from_easymocap(Rh, Th, pelvis)


def pose_without_root(fit: RawFit) -> types.Float64:
    """The fit's pose (24, 3) with zero root rotation."""
    axis_angles = fit.pose.copy()
    axis_angles[0] = 0.0
    return axis_angles


def stored_vertices(path: Path, model: BodyModel) -> types.Float64:
    """The vertices (V, 3) of a file, metres, float64.

    Raises:
        PickleError: the file is damaged.
        SourceError: the file holds something else, or another number of vertices than the model.
    """
    content = load_npy(path)
    if not isinstance(content, np.ndarray) or content.dtype.kind != "f" or content.size % 3:
        raise SourceError(f"{path}: expected an array of vertices (V, 3).")
    vertices = content.reshape(-1, 3).astype(np.float64)
    if len(vertices) != len(model.template):
        raise SourceError(
            f"{path}: has {len(vertices)} vertices, but the body model has {len(model.template)}: "
            "pass the body model that the fits were made with (--body-model)."
        )
    return vertices


def largest_distance(a: types.Float64, b: types.Float64) -> float:
    """The largest distance between corresponding points, metres."""
    return float(np.linalg.norm(a - b, axis=1).max())


def _vector(
    path: Path, content: Mapping[str, object], key: str, sizes: tuple[int, ...]
) -> types.Float64:
    if key not in content:
        raise SourceError(f"{path}: has no entry {key!r}; found {sorted(map(str, content))}.")
    try:
        values = np.asarray(content[key], np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise SourceError(f"{path}: entry {key!r} does not hold numbers ({error}).") from error
    if values.size not in sizes:
        expected = " or ".join(map(str, sizes))
        raise SourceError(f"{path}: entry {key!r} has {values.size} numbers, expected {expected}.")
    if not np.isfinite(values).all():
        raise SourceError(f"{path}: entry {key!r} is not finite.")
    return values
