"""From densities along rays to colours: the absorbed light of each sample, added up."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

FULL = 1 - 2.0**-23
"""Opacity beyond which a softly masked sample counts as opaque; the logarithm stays finite."""


@dataclass(frozen=True)
class Composited:
    """Rays in a picture."""

    rgb: Float[Tensor, "rays 3"]
    alpha: Float[Tensor, "rays"]
    """Light stopped by the samples; 1 - alpha comes from the background."""
    depth: Float[Tensor, "rays"]
    """Expected depth times alpha, metres."""
    weights: Float[Tensor, "rays samples"]
    """Each sample's share of the pixel; with 1 - alpha they sum to 1."""


def optical_depth(
    density: Float[Tensor, "*samples"],
    spacing: Float[Tensor, "*samples"],
    likelihood: Float[Tensor, "*samples"] | None,
) -> Float[Tensor, "*samples"]:
    """Minus the logarithm of the light that passes each sample.

    Args:
        density: 1/metre; negative counts as 0.
        spacing: length that a sample stands for, metres.
        likelihood: multiplies the opacity (the soft mask of HumanNeRF); None leaves it alone.
    """
    thickness = density.clamp(min=0) * spacing
    if likelihood is None:
        return thickness
    opacity = (-torch.expm1(-thickness) * likelihood).clamp(0, FULL)
    return -torch.log1p(-opacity)


def shares_so_far(
    thickness: Float[Tensor, "samples"], ray: Int[Tensor, "samples"]
) -> Float[Tensor, "samples"]:
    """At most what each sample can add to its pixel, judged by the samples given before it.

    Samples that are not given could only take light away.

    Args:
        thickness: optical depth of each sample, non-negative.
        ray: of each sample; those of one ray stand together, front to back.

    >>> shares_so_far(torch.tensor([0.0, 200.0, 1.0, 1.0]), torch.tensor([0, 0, 0, 1])).tolist()
    [0.0, 1.0, 0.0, 0.6321205496788025]
    """
    # Beyond an optical depth of 200 nothing is left in float32; the sum over rays stays exact.
    bounded = thickness.double().clamp(max=200.0)
    before = bounded.cumsum(0) - bounded
    begins = torch.ones_like(ray, dtype=torch.bool)
    begins[1:] = ray[1:] != ray[:-1]
    start = torch.where(begins, before, 0.0).cummax(0).values if len(ray) else before
    return (torch.exp(start - before) * -torch.expm1(-bounded)).to(thickness.dtype)


def composite(
    rgb: Float[Tensor, "rays samples 3"],
    thickness: Float[Tensor, "rays samples"],
    depths: Float[Tensor, "rays samples"],
    background: Float[Tensor, "3"],
) -> Composited:
    """The colours of rays whose samples absorb and emit, before a background.

    Weight of sample i: exp(-thickness of all before it) (1 - exp(-its thickness)). The weights and
    the passing light sum to 1 by construction, whatever the densities. (The released code
    multiplies 1 - alpha + 1e-10 and does not quite sum to 1.)

    Args:
        rgb: of each sample, in [0, 1].
        thickness: optical depth of each sample, non-negative.
        depths: of each sample, metres.
        background: blend target.

    Source: NeRF eq. 3.

    >>> solid = torch.full((1, 2), 50.0)
    >>> composite(torch.ones(1, 2, 3), solid, torch.ones(1, 2), torch.zeros(3)).rgb.tolist()
    [[1.0, 1.0, 1.0]]
    """
    through = thickness.cumsum(-1)
    before = torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], -1)
    weights = torch.exp(-before) * -torch.expm1(-thickness)
    passing = torch.exp(-thickness.sum(-1))
    colour = (weights[..., None] * rgb).sum(-2) + passing[:, None] * background
    return Composited(colour, weights.sum(-1), (weights * depths).sum(-1), weights)


__all__ = ["Composited", "composite", "optical_depth", "shares_so_far"]
