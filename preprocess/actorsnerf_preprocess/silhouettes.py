"""The projected body as a picture: which pixels of a camera its triangles cover."""

import cv2
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float64, Int64
from actorsnerf_preprocess.source import SourceCamera

NEAREST_METRES = 0.05
"""Vertices nearer to the camera plane than this are not drawn."""
_SUBPIXEL_BITS = 4


def project_points(points: Float64, camera: SourceCamera) -> tuple[Float64, NDArray[np.bool_]]:
    """(pixels, whether the point lies in front) in the distorted picture as the source has it.

    Args:
        points: (N, 3) world frame, metres.
        camera: of the source.
    """
    in_front = (points @ camera.R.T + camera.T)[:, 2] > NEAREST_METRES
    shown = np.where(in_front[:, None], points, points[in_front].mean(0) if in_front.any() else 0)
    rotation, _ = cv2.Rodrigues(camera.R)
    pixels, _ = cv2.projectPoints(
        np.ascontiguousarray(shown, np.float64), rotation, camera.T, camera.K, camera.distortion
    )
    return np.asarray(pixels, np.float64).reshape(-1, 2), in_front


def body_silhouette(
    vertices: Float64, faces: Int64, camera: SourceCamera, scale: float = 1.0
) -> NDArray[np.uint8]:
    """(H, W) 255 where a body of triangles covers the picture, 0 elsewhere.

    Args:
        vertices: (V, 3) world frame, metres.
        faces: (F, 3) rows of `vertices`.
        camera: of the source; its distortion is applied.
        scale: picture scale; pixel c becomes (c + 0.5) scale - 0.5.
    """
    width, height = (round(scale * side) for side in camera.size)
    canvas = np.zeros((height, width), np.uint8)
    pixels, in_front = project_points(vertices, camera)
    pixels = np.clip((pixels + 0.5) * scale - 0.5, -4096, 16384)
    corners = np.rint(pixels * (1 << _SUBPIXEL_BITS)).astype(np.int32)
    drawn = faces[in_front[faces].all(1)]
    edges = pixels[drawn[:, 1:]] - pixels[drawn[:, :1]]
    area = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    # A closed surface shows each pixel by a triangle of either side; one side is enough.
    side = area > 0 if (area > 0).sum() <= (area < 0).sum() else area < 0
    for triangle in corners[drawn[side]]:
        cv2.fillConvexPoly(canvas, triangle, 255, cv2.LINE_8, _SUBPIXEL_BITS)
    return canvas


def person_box(mask: NDArray[np.uint8], margin: int) -> tuple[int, int, int, int] | None:
    """(left, top, right, bottom) around the set pixels, widened and cut to the picture.

    >>> import numpy as np
    >>> mask = np.zeros((10, 20), np.uint8)
    >>> mask[4:6, 7:9] = 255
    >>> person_box(mask, 2)
    (5, 2, 11, 8)
    """
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return None
    height, width = mask.shape
    return (
        max(int(columns[0]) - margin, 0),
        max(int(rows[0]) - margin, 0),
        min(int(columns[-1]) + 1 + margin, width),
        min(int(rows[-1]) + 1 + margin, height),
    )
