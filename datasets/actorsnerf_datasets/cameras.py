"""Pinhole cameras in numpy: projection, lens distortion, scaled and cropped intrinsics.

OpenCV axes (x right, y down, z forward); the centre of the top-left pixel is (0, 0).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float64


@dataclass(frozen=True)
class Projection:
    """Where points land in a picture."""

    pixels: Float64
    """(..., 2) x, y; NaN where not in front."""
    depth: Float64
    """(...,) metres along the optical axis."""
    in_front: NDArray[np.bool_]
    """(...,) depth > 0."""


def camera_from_world(R: Float64, T: Float64) -> Float64:
    """The rigid transforms (..., 4, 4) of rotations (..., 3, 3) and translations (..., 3)."""
    matrix = np.zeros((*T.shape[:-1], 4, 4))
    matrix[..., :3, :3] = R
    matrix[..., :3, 3] = T
    matrix[..., 3, 3] = 1.0
    return matrix


def camera_centre(R: Float64, T: Float64) -> Float64:
    """Where the cameras stand (..., 3), world, metres: `-R^T T`, which is not T."""
    centre: Float64 = -(np.swapaxes(R, -1, -2) @ T[..., None])[..., 0]
    return centre


def project(points: Float64, K: Float64, camera_from_points: Float64) -> Projection:
    """The pinhole projection of points.

    Args:
        points: (..., 3) metres, in any frame.
        K: (3, 3) intrinsics, pixels.
        camera_from_points: (4, 4) rigid, from the points' frame.

    >>> K = np.array([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]])
    >>> project(np.array([[0.1, 0.0, 2.0], [0.0, 0.0, -1.0]]), K, np.eye(4)).pixels.tolist()
    [[55.0, 50.0], [nan, nan]]
    """
    return project_distorted(points, K, camera_from_points, np.zeros(5))


def project_distorted(
    points: Float64, K: Float64, camera_from_points: Float64, distortion: Float64
) -> Projection:
    """Where points land in the picture as the lens made it, before undistortion.

    Args:
        points: (..., 3) metres, in any frame.
        K: (3, 3) intrinsics, pixels.
        camera_from_points: (4, 4) rigid, from the points' frame.
        distortion: (5,) k1 k2 p1 p2 k3, OpenCV.
    """
    camera = points @ camera_from_points[:3, :3].T + camera_from_points[:3, 3]
    depth = camera[..., 2]
    in_front = depth > 0
    rays = camera[..., :2] / np.where(in_front, depth, np.nan)[..., None]
    rays = distorted(rays, distortion)
    pixels = rays @ K[:2, :2].T + K[:2, 2]
    return Projection(pixels=pixels, depth=depth, in_front=in_front)


def distorted(rays: Float64, distortion: Float64) -> Float64:
    """Normalised image coordinates (..., 2) after the lens (OpenCV's five-number model).

    Args:
        rays: (..., 2) x/z, y/z of an ideal pinhole.
        distortion: (5,) k1 k2 p1 p2 k3.

    Source: OpenCV, "Camera Calibration and 3D Reconstruction".
    """
    if not np.any(distortion):
        return rays
    k1, k2, p1, p2, k3 = distortion
    x, y = rays[..., 0], rays[..., 1]
    square = x * x + y * y
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    moved = np.empty_like(rays)  # in the memory order of `rays`: two rows of numbers stay two rows
    moved[..., 0] = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    moved[..., 1] = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
    return moved


def scaled_intrinsics(K: Float64, scale: float | tuple[float, float]) -> Float64:
    """Intrinsics (..., 3, 3) of a picture resized by a factor, or by one for x and one for y.

    Pixel centres are at integers, so a coordinate c becomes `(c + 0.5) scale - 0.5`; the half
    pixel is what `K * scale` misses.

    >>> scaled_intrinsics(np.array([[8.0, 0, 3.5], [0, 8, 3.5], [0, 0, 1]]), 0.5).tolist()
    [[4.0, 0.0, 1.5], [0.0, 4.0, 1.5], [0.0, 0.0, 1.0]]
    """
    scale_x, scale_y = scale if isinstance(scale, tuple) else (scale, scale)
    pixel_from_pixel = np.array(
        [
            [scale_x, 0.0, 0.5 * scale_x - 0.5],
            [0.0, scale_y, 0.5 * scale_y - 0.5],
            [0.0, 0.0, 1.0],
        ]
    )
    scaled: Float64 = pixel_from_pixel @ K
    return scaled


def cropped_intrinsics(K: Float64, offset: tuple[int, int]) -> Float64:
    """Intrinsics (..., 3, 3) of a crop whose top-left pixel is (x, y) = `offset` of the picture."""
    cropped = K.copy()
    cropped[..., 0, 2] -= offset[0]
    cropped[..., 1, 2] -= offset[1]
    return cropped
