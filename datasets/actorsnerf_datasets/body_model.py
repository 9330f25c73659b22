"""Bodies in the SMPL file format: the reader and linear blend skinning, in float64.

Any vertex count. Model files are licensed to their users: nothing of them is ever written into a
prepared sequence except posed and rest vertices and joints.
"""

import hashlib
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.errors import BodyModelError
from actorsnerf_datasets.layout import JOINT_COUNT
from actorsnerf_datasets.pickles import load_pickle
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.skeleton import PARENTS, joint_transforms, posed_joints
from actorsnerf_datasets.types import Float64, Int64

SHAPE_COUNT = 10
"""Shape coefficients used; files of SMPL 1.1.0 have 300, of which the first ten are the same."""
POSE_FEATURE_COUNT = (JOINT_COUNT - 1) * 9
"""Entries of 23 rotation matrices."""
_KEYS = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")


@dataclass(frozen=True)
class BodyModel:
    """A body that can be shaped and posed; metres, V vertices."""

    template: Float64
    """(V, 3)."""
    shape_directions: Float64
    """(V, 3, B) metres per unit of each shape coefficient, B <= 10."""
    pose_directions: Float64
    """(V, 3, 207) metres per entry of `R_j - I`, joints 1 to 23, row-major."""
    joint_regressor: Float64
    """(24, V)."""
    weights: Float64
    """(V, 24) skinning weights; rows sum to 1."""
    faces: Int64
    """(faces, 3)."""
    digest: str
    """Hex SHA-256 of the file."""


@dataclass(frozen=True)
class PosedBody:
    """A body in a pose; metres. The body frame when the root rotation is zero."""

    vertices: Float64
    """(V, 3)."""
    joints: Float64
    """(24, 3)."""
    rest_joints: Float64
    """(24, 3) the same shape in the zero pose."""


def load_body_model(path: Path) -> BodyModel:
    """The body in an SMPL-format file: a .pkl as distributed (no chumpy needed), or an .npz.

    Raises:
        BodyModelError: the file is missing, or an entry is missing or has another shape.
        PickleError: the pickle is damaged or names something it should not.
    """
    if not path.is_file():
        raise BodyModelError(
            f"{path}: no such body-model file: register at https://smpl.is.tue.mpg.de, download "
            "SMPL for Python, and pass the .pkl inside it"
        )
    entries = _npz_entries(path) if path.suffix == ".npz" else _pickle_entries(path)
    arrays = {key: _entry(path, entries, key) for key in _KEYS}
    _require_smpl_tree(path, arrays["kintree_table"])
    numbers = {key: arrays[key].astype(np.float64) for key in _KEYS[:5]}
    return BodyModel(
        template=numbers["v_template"],
        shape_directions=np.ascontiguousarray(numbers["shapedirs"][..., :SHAPE_COUNT]),
        pose_directions=numbers["posedirs"],
        joint_regressor=numbers["J_regressor"],
        weights=numbers["weights"],
        faces=arrays["f"].astype(np.int64),
        digest=hashlib.sha256(path.read_bytes()).hexdigest(),
    )


def rest(model: BodyModel, betas: Float64) -> tuple[Float64, Float64]:
    """Joints (24, 3) and vertices (V, 3) of a shape in the zero pose, body frame, metres.

    Args:
        model: the body.
        betas: (B,) shape coefficients; fewer than the model has are filled with zeros.

    Raises:
        BodyModelError: more non-zero coefficients than the model has.
    """
    count = model.shape_directions.shape[-1]
    if np.any(betas[count:]):
        raise BodyModelError(
            f"{len(betas)} shape coefficients, but the body model has {count}: use the model that "
            "the fits were made with"
        )
    used = betas[:count]
    vertices = model.template + model.shape_directions[..., : len(used)] @ used
    return model.joint_regressor @ vertices, vertices


def pose(
    model: BodyModel, betas: Float64, axis_angles: Float64, pose_blend: bool = True
) -> PosedBody:
    """A body of the given shape in the given pose, metres.

    Args:
        model: the body.
        betas: (B,) shape coefficients.
        axis_angles: (24, 3) joint rotations, radians. A root rotation turns about the rest pelvis.
        pose_blend: add the pose blend shapes. ZJU-MoCap's older fits (`params`) are without.

    Source: SMPL (Loper et al. 2015), eq. 2 to 9.
    """
    rest_joints, vertices = rest(model, betas)
    if pose_blend:
        feature = matrix_from_axis_angle(axis_angles[1:]) - np.eye(3)
        vertices = vertices + model.pose_directions @ feature.ravel()
    transforms = joint_transforms(axis_angles, rest_joints)
    return PosedBody(
        vertices=lbs(vertices, model.weights, transforms),
        joints=posed_joints(axis_angles, rest_joints),
        rest_joints=rest_joints,
    )


def lbs(vertices: Float64, weights: Float64, transforms: Float64) -> Float64:
    """Vertices (V, 3) moved by linear blend skinning.

    Args:
        vertices: (V, 3) at rest.
        weights: (V, 24) rows sum to 1.
        transforms: (24, 4, 4) `skeleton.joint_transforms`.
    """
    blended = (weights @ transforms[:, :3].reshape(len(transforms), 12)).reshape(-1, 3, 4)
    moved: Float64 = (blended[:, :, :3] @ vertices[:, :, None])[..., 0]
    return moved + blended[:, :, 3]


def _npz_entries(path: Path) -> dict[str, object]:
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            return {key: archive[key] for key in _KEYS if key in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise BodyModelError(
            f"{path}: not a readable .npz of plain arrays ({error}): is the file complete?"
        ) from error


def _pickle_entries(path: Path) -> dict[str, object]:
    content = load_pickle(path)
    if not isinstance(content, dict):
        raise BodyModelError(
            f"{path}: holds a {type(content).__name__}, expected SMPL's dictionary: is this "
            "another kind of file?"
        )
    return content


def _entry(path: Path, entries: dict[str, object], key: str) -> NDArray[np.generic]:
    if key not in entries:
        raise BodyModelError(
            f"{path}: has no entry {key!r}; an SMPL-format file has {', '.join(_KEYS)}: was it "
            "exported incompletely?"
        )
    array = np.asarray(entries[key])
    template = np.asarray(entries["v_template"])
    count = template.shape[0] if template.ndim else 0
    expected: dict[str, tuple[int | None, ...]] = {
        "v_template": (None, 3),
        "shapedirs": (count, 3, None),
        "posedirs": (count, 3, POSE_FEATURE_COUNT),
        "J_regressor": (JOINT_COUNT, count),
        "weights": (count, JOINT_COUNT),
        "kintree_table": (2, JOINT_COUNT),
        "f": (None, 3),
    }
    shape = expected[key]
    fits = array.ndim == len(shape) and all(
        size in (None, found) for size, found in zip(shape, array.shape, strict=True)
    )
    if not fits or array.dtype.kind not in "fiu":
        raise BodyModelError(
            f"{path}: entry {key!r} is {array.dtype} {array.shape}, expected numbers "
            f"{tuple('any' if size is None else size for size in shape)}: is this an SMPL model "
            "(not SMPL+H or SMPL-X)?"
        )
    return array


def _require_smpl_tree(path: Path, table: NDArray[np.generic]) -> None:
    parents = tuple(int(parent) for parent in table[0].tolist()[1:])
    if parents != PARENTS[1:]:
        raise BodyModelError(
            f"{path}: its joint tree is not SMPL's (parents {parents}): is this another skeleton?"
        )
