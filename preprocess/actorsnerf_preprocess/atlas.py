"""Where on the body each texel of a texture lies, so that clothes can be painted in space."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from actorsnerf_datasets.types import Float32, Float64, Int64
from actorsnerf_preprocess.free_body import Atlas

SAMPLES_PER_TEXEL = 1.5
"""Points laid on a triangle per texel of its longest edge; above 1 leaves no holes inside."""


@dataclass(frozen=True)
class SeamedMesh:
    """A mesh whose vertices repeat along texture seams, as a renderer wants it."""

    source: Int64
    """(S,) vertex of the unseamed mesh."""
    faces: Int64
    """(F, 3)."""
    uv: Float32
    """(S, 2)."""


def cut_seams(faces: Int64, atlas: Atlas) -> SeamedMesh:
    """The mesh with one vertex per pair (vertex, texture coordinate); faces keep their order."""
    corners = np.stack([faces.ravel(), atlas.faces.ravel()], axis=1)
    pairs, index = np.unique(corners, axis=0, return_inverse=True)
    return SeamedMesh(pairs[:, 0], index.reshape(-1, 3), atlas.uv[pairs[:, 1]])


def texel_values(vertex_values: Float64, faces: Int64, atlas: Atlas, size: int) -> Float32:
    """(size, size, C) values interpolated from vertices; texels off the mesh take the nearest's.

    With rest positions as values this is the map that textures are painted on.
    """
    triangles = atlas.uv[atlas.faces].astype(np.float64) * [size, -size] + [0, size]
    edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    steps = np.ceil(edges * SAMPLES_PER_TEXEL).astype(int) + 1
    values = np.zeros((size, size, vertex_values.shape[1]), dtype=np.float32)
    empty = np.ones((size, size), dtype=bool)
    for count in np.unique(steps):
        chosen = steps == count
        weights = _barycentric_grid(int(count))
        xy = np.einsum("sk,fkc->fsc", weights, triangles[chosen]).reshape(-1, 2)
        columns, rows = np.clip(np.floor(xy), 0, size - 1).astype(int).T
        corner_values = vertex_values[faces[chosen]]
        values[rows, columns] = np.einsum("sk,fkc->fsc", weights, corner_values).reshape(
            -1, values.shape[2]
        )
        empty[rows, columns] = False
    nearest = distance_transform_edt(empty, return_distances=False, return_indices=True)
    filled: Float32 = values[tuple(nearest)]
    return filled


def _barycentric_grid(count: int) -> Float64:
    """(n, 3) weights of a regular grid with `count` steps per edge."""
    i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
    inside = i + j <= count
    return np.stack([i[inside], j[inside], count - i[inside] - j[inside]], axis=1) / count
