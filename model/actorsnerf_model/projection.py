"""Where points of the body frame fall in a picture, and whether the camera can see them at all."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

NEAR_PLANE = 0.01
"""Metres in front of the camera below which nothing counts as visible."""


@dataclass(frozen=True)
class Projected:
    """Points in a picture."""

    pixels: Float[Tensor, "*batch points 2"]
    """x, y; the centre of the top-left pixel is (0, 0). Finite everywhere; meaningful only where
    `in_front`."""
    in_front: Bool[Tensor, "*batch points"]
    """True beyond `NEAR_PLANE`."""
    depth: Float[Tensor, "*batch points"]
    """Along the optical axis, metres; negative behind the camera."""


def project(
    points: Float[Tensor, "*batch points 3"],
    K: Float[Tensor, "*batch 3 3"],
    camera_from_body: Float[Tensor, "*batch 4 4"],
) -> Projected:
    """Pixels, visibility and depth of points; value and gradient are finite at any depth.

    Up to `NEAR_PLANE` and behind it the division is by `NEAR_PLANE`, and `in_front` is False. The
    released code divides by any depth: a point behind the camera reads a mirrored pixel.

    Args:
        points: body frame, metres.
        K: pixels.
        camera_from_body: rigid, metres.
    """
    rotation, translation = camera_from_body[..., :3, :3], camera_from_body[..., :3, 3]
    with torch.autocast(points.device.type, enabled=False):  # half a precision is pixels off
        in_camera = points @ rotation.transpose(-1, -2) + translation[..., None, :]
        depth = in_camera[..., 2]
        rays = in_camera[..., :2] / depth.clamp(min=NEAR_PLANE)[..., None]
        pixels = rays @ K[..., :2, :2].transpose(-1, -2) + K[..., None, :2, 2]
    return Projected(pixels, depth > NEAR_PLANE, depth)


__all__ = ["NEAR_PLANE", "Projected", "project"]
