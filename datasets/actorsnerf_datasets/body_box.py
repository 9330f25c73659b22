"""Which pixels look at a body: those whose ray meets the box around its posed joints."""

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float64

BOX_MARGIN = 0.3
"""Metres between the outermost joints and the box (released code)."""


def body_box(posed_joints: Float64, margin: float = BOX_MARGIN) -> Float64:
    """Lower and upper corner (2, 3) of the box around a frame's joints (24, 3), body frame.

    >>> body_box(np.zeros((24, 3))).tolist()
    [[-0.3, -0.3, -0.3], [0.3, 0.3, 0.3]]
    """
    return np.stack([posed_joints.min(axis=0) - margin, posed_joints.max(axis=0) + margin])


def meets_box(
    pixels: Float64, K: Float64, camera_from_body: Float64, box: Float64
) -> NDArray[np.bool_]:
    """Whether each pixel's ray (pixels (N, 2): x, y) meets the box in front of the camera.

    A ray that touches a face, an edge or a corner meets the box, and so does every ray of a
    camera inside it.

    Args:
        pixels: x, y; centres are integers.
        K: (3, 3) intrinsics of the picture the pixels belong to.
        camera_from_body: (4, 4) rigid.
        box: (2, 3) lower and upper corner, body frame, metres.
    """
    rotation, translation = camera_from_body[:3, :3], camera_from_body[:3, 3]
    homogeneous = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1)
    directions = homogeneous @ np.linalg.inv(K).T @ rotation  # rows: R^T K^-1 (x, y, 1)
    origin = -rotation.T @ translation
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # parallel to a face
        through = (box[None] - origin) / directions[:, None]  # (N, 2, 3)
    parallel = directions == 0.0
    between = (box[0] <= origin) & (origin <= box[1])
    near = np.where(parallel, np.where(between, -np.inf, np.inf), through.min(axis=1))
    far = np.where(parallel, np.where(between, np.inf, -np.inf), through.max(axis=1))
    enter, leave = near.max(axis=1), far.min(axis=1)
    hit: NDArray[np.bool_] = (enter <= leave) & (leave > 0.0)
    return hit


def box_mask(
    size: tuple[int, int], K: Float64, camera_from_body: Float64, box: Float64
) -> NDArray[np.bool_]:
    """The pixels (H, W) of a whole picture, `size` = (width, height), whose ray meets the box."""
    width, height = size
    x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    return meets_box(pixels, K, camera_from_body, box).reshape(height, width)
