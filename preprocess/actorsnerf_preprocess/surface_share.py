"""How much of a body's surface a camera has seen."""

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float64, Int64
from actorsnerf_preprocess.shots import View

COVER = 0.06
"""Metres of clothes and hair that may lie between the body and what is drawn."""
GRAZING = 0.25
"""Cosine below which a surface is seen too flat to count: a quarter of its pixels are left."""


def vertex_areas(vertices: Float64, faces: Int64) -> Float64:
    """(V,) each vertex's share of the mesh's surface; sums to one.

    >>> vertex_areas(np.eye(3), np.array([[0, 1, 2]])).round(3).tolist()
    [0.333, 0.333, 0.333]
    """
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    shares = np.bincount(faces.ravel(), np.repeat(areas, 3), minlength=len(vertices))
    whole: Float64 = shares / shares.sum()
    return whole


def seen_vertices(view: View, vertices: Float64, normals: Float64) -> NDArray[np.bool_]:
    """(V,) which vertices face the camera with nothing but clothes in front of them.

    Args:
        view: a drawing of the dressed body.
        vertices: (V, 3) of the body, world frame.
        normals: (V, 3) unit.
    """
    camera, depth = view.camera, view.drawing.depth
    local = vertices @ camera.R.T + camera.T
    facing = np.einsum("vk,vk->v", normals @ camera.R.T, -local) > GRAZING * np.linalg.norm(
        local, axis=1
    )
    pixels = np.rint((local @ camera.K.T)[:, :2] / np.maximum(local[:, 2:], 1e-6)).astype(int)
    width, height = camera.size
    inside = ((pixels >= 0) & (pixels < [width, height])).all(axis=1) & (local[:, 2] > 0)
    seen = np.zeros(len(vertices), dtype=bool)
    columns, rows = pixels[inside].T
    drawn = depth[rows, columns]
    seen[inside] = (drawn > 0) & (local[inside, 2] < drawn + COVER)
    seen &= facing
    return seen
