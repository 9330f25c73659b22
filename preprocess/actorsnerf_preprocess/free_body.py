"""The free body: a SMPL-format model of a person that anyone may use, its clothes, and a tiny twin.

Frame: SMPL's own (x to the person's left, y up, z to the front, metres, T-pose at rest).
`body/cc0_body.md` says where the data come from.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.body_model import BodyModel, load_body_model
from actorsnerf_datasets.skeleton import PARENTS
from actorsnerf_datasets.types import Float32, Float64, Int64

FREE_BODY_NAME = "cc0 body"
"""What prepared files call this body model."""
_FOLDER = Path(__file__).parent / "body"
_TINY_HALF_WIDTH = 0.05
_TINY_SEED = 7


@dataclass(frozen=True)
class Atlas:
    """How a texture lies on a mesh."""

    uv: Float32
    """(U, 2) in [0, 1]; v = 1 is the top row of the texture."""
    faces: Int64
    """(F, 3) rows of `uv`, one per corner of the mesh's faces."""


@dataclass(frozen=True)
class Garment:
    """Something worn that follows the body's joints and shape."""

    template: Float64
    """(V, 3) on the template body, at rest."""
    shape_directions: Float64
    """(V, 3, 10) metres per unit of the body's betas."""
    weights: Float64
    """(V, 24)."""
    faces: Int64
    atlas: Atlas


def free_body_path() -> Path:
    """The packaged model file, for `--body-model`.

    >>> free_body_path().name
    'cc0_body.npz'
    """
    return _FOLDER / "cc0_body.npz"


def free_body() -> BodyModel:
    """The free body: 13,524 vertices, 24 joints, 10 shape coefficients, pose blend shapes."""
    return load_body_model(free_body_path())


def free_body_atlas() -> Atlas:
    """The texture coordinates of `free_body`."""
    with np.load(free_body_path()) as arrays:
        return Atlas(arrays["uv"], arrays["uv_f"].astype(np.int64))


def free_wardrobe() -> dict[str, Garment]:
    """The pieces `suit` (neck to ankles and wrists), `skirt` and `hair`."""
    with np.load(_FOLDER / "cc0_wardrobe.npz") as arrays:
        return {
            name: Garment(
                arrays[f"{name}_vertices"].astype(np.float64),
                arrays[f"{name}_shapedirs"].astype(np.float64),
                arrays[f"{name}_weights"].astype(np.float64),
                arrays[f"{name}_f"].astype(np.int64),
                Atlas(arrays[f"{name}_uv"], arrays[f"{name}_uv_f"].astype(np.int64)),
            )
            for name in ("suit", "skirt", "hair")
        }


def write_tiny_body(path: Path) -> Path:
    """Writes a SMPL-format .npz of 192 vertices, a box per joint, for quick tests; returns `path`.

    It has the free body's joints, so poses and betas mean the same for both.
    """
    with np.load(free_body_path()) as arrays:
        regressor = arrays["J_regressor"].astype(np.float64)
        joints = regressor @ arrays["v_template"]
        joint_directions = np.einsum("jv,vkb->jkb", regressor, arrays["shapedirs"])
        kintree = arrays["kintree_table"]
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    box = np.array([0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1])
    box = np.concatenate([box, [2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3]])
    rng = np.random.default_rng(_TINY_SEED)
    weights = np.kron(np.eye(24), np.full((8, 1), 0.75))
    for joint, parent in enumerate(PARENTS):
        weights[8 * joint : 8 * joint + 8, max(parent, 0)] += 0.25
    np.savez_compressed(
        path,
        v_template=(joints[:, None] + _TINY_HALF_WIDTH * corners).reshape(-1, 3),
        shapedirs=np.repeat(joint_directions, 8, axis=0),
        posedirs=rng.normal(0.0, 1e-3, (192, 3, 207)),
        J_regressor=np.kron(np.eye(24), np.full((1, 8), 1 / 8)),
        weights=weights,
        kintree_table=kintree,
        f=(box.reshape(-1, 3) + 8 * np.arange(24)[:, None, None]).reshape(-1, 3),
    )
    return path
