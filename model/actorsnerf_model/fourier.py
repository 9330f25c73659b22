"""Coordinates as sines and cosines, and the window that opens their octaves one by one."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.constants import constant


def fourier_features(
    values: Float[Tensor, "*batch axes"], octaves: int, identity: bool = False
) -> Float[Tensor, "*batch features"]:
    """Sines and cosines of the values times 1, 2, 4, ...: [x,] sin x, cos x, sin 2x, cos 2x, ...

    Args:
        values: dimensionless (normalised coordinates) or metres, as the network was trained.
        octaves: how many doublings.
        identity: whether the values themselves come first.

    Returns:
        `axes * (2 * octaves + identity)` features. No factor of pi, as in the released code.

    >>> fourier_features(torch.zeros(1, 3), 2).tolist()
    [[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]]
    """
    scales = 2.0 ** torch.arange(octaves, dtype=values.dtype, device=values.device)
    angles = values[..., None, :] * scales[:, None]
    waves = torch.cat([angles.sin(), angles.cos()], dim=-1).flatten(-2)
    return torch.cat([values, waves], dim=-1) if identity else waves


def hann_window(opened: float, octaves: int) -> tuple[float, ...]:
    """Each octave's weight, (1 - cos(pi * clamp(opened - j, 0, 1))) / 2 for octave j.

    Source: the annealed encoding of Nerfies, eq. 8, as the released code uses it.

    >>> hann_window(1.5, 3)[0], round(hann_window(1.5, 3)[1], 6), hann_window(1.5, 3)[2]
    (1.0, 0.5, 0.0)
    """
    return tuple(
        (1 - math.cos(math.pi * min(max(opened - j, 0.0), 1.0))) / 2 for j in range(octaves)
    )


def annealed_fourier_features(
    values: Float[Tensor, "*batch axes"], octaves: int, opened: float
) -> Float[Tensor, "*batch features"]:
    """Fourier features without identity, each octave times its Hann weight."""
    weights = constant(hann_window(opened, octaves), values)
    waves = fourier_features(values, octaves)
    return waves * weights.repeat_interleave(2 * values.shape[-1])
