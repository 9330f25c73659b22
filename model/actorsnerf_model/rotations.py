"""Rotation matrices from axis-angle vectors, smooth at every angle."""

import torch
from jaxtyping import Float
from torch import Tensor

_SERIES_BELOW = 1e-2
"""Squared angle (rad^2) under which the Taylor series is exact to float64."""


def matrix_from_axis_angle(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotation matrices, orthogonal to rounding, with smooth gradients at 0 and pi.

    Rodrigues' formula I + a K + b K^2 with a = sin t / t and b = (1 - cos t) / t^2; near 0 both
    are series in t^2, so no square root of zero is ever differentiated. The released code divides
    by t + 1e-5 instead and is not orthogonal for small angles.

    Args:
        axis_angle: radians; any length, also beyond 2 pi.

    >>> matrix_from_axis_angle(torch.zeros(3)).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    squared = (axis_angle * axis_angle).sum(-1)
    a, b = _sinc_terms(squared)
    x, y, z = axis_angle.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1)
    cross = cross.reshape(*axis_angle.shape[:-1], 3, 3)
    outer = axis_angle[..., :, None] * axis_angle[..., None, :]
    identity = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    cosine = (1 - b * squared)[..., None, None]
    return cosine * identity + a[..., None, None] * cross + b[..., None, None] * outer


def _sinc_terms(
    squared: Float[Tensor, "*batch"],
) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
    """The functions sin t / t and (1 - cos t) / t^2 of t^2."""
    small = squared < _SERIES_BELOW
    safe = torch.where(small, torch.ones_like(squared), squared)
    angle = safe.sqrt()
    half = torch.sin(angle / 2)
    near = torch.where(small, squared, torch.zeros_like(squared))
    a_series = 1 - near / 6 * (1 - near / 20 * (1 - near / 42 * (1 - near / 72)))
    b_series = 0.5 * (1 - near / 12 * (1 - near / 30 * (1 - near / 56 * (1 - near / 90))))
    a = torch.where(small, a_series, torch.sin(angle) / angle)
    b = torch.where(small, b_series, 2 * half * half / safe)
    return a, b


__all__ = ["matrix_from_axis_angle"]
