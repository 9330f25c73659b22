"""What training minimises: a perceptual distance of patches, their squared error, a prior's pull.

loss = 1.0 perceptual + 0.2 squared error (+ 0.01 skinning residual in category training)
(paper, eq. 9 and section 4.1; weights as in the released code).
"""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from actorsnerf_train.lpips import Lpips

PYRAMID_LEVELS = 4
"""Scales of the substitute: the patch and three halvings."""


@dataclass(frozen=True)
class LossWeights:
    """How much each term counts."""

    perceptual: float = 1.0
    """Paper, section 4.1."""
    squared_error: float = 0.2
    """Paper, section 4.1."""
    skinning: float = 0.01
    """Paper, section 4.1; category training only (few-shot fitting freezes the volume)."""


@dataclass(frozen=True)
class Losses:
    """One step's terms, unweighted, and their weighted sum."""

    total: Float[Tensor, ""]
    perceptual: Float[Tensor, ""]
    squared_error: Float[Tensor, ""]
    skinning: Float[Tensor, ""]


class GradientPyramid(nn.Module):
    """The stated substitute where no LPIPS weights are installed; never called LPIPS.

    Mean absolute error of the pictures' horizontal and vertical differences, over four scales, plus
    the mean absolute error at the coarsest: sharpness without a network.
    """

    def forward(
        self,
        prediction: Float[Tensor, "pictures 3 height width"],
        target: Float[Tensor, "pictures 3 height width"],
    ) -> Float[Tensor, " pictures"]:
        """The distance of each pair of pictures."""
        error = prediction - target
        distance = error.new_zeros(error.shape[0])
        for level in range(PYRAMID_LEVELS):
            if level:
                error = nn.functional.avg_pool2d(error, kernel_size=2)
            for axis in (2, 3):
                if error.shape[axis] > 1:
                    distance = distance + error.diff(dim=axis).abs().mean(dim=(1, 2, 3))
            if min(error.shape[2:]) < 2:
                break
        return distance / PYRAMID_LEVELS + error.abs().mean(dim=(1, 2, 3))


class Perceptual(nn.Module):
    """The perceptual distance a run trains with: LPIPS where there are weights, else a substitute.

    Attributes:
        name: "lpips" or "gradient_pyramid"; logged with every number.
    """

    def __init__(self, lpips: Lpips | None) -> None:
        super().__init__()
        self.name: Literal["lpips", "gradient_pyramid"] = (
            "gradient_pyramid" if lpips is None else "lpips"
        )
        self.distance: nn.Module = GradientPyramid() if lpips is None else lpips

    def forward(
        self,
        prediction: Float[Tensor, "patches side side 3"],
        target: Float[Tensor, "patches side side 3"],
    ) -> Float[Tensor, ""]:
        """Mean distance of the patches; colours in [0, 1], carried to [-1, 1] (released code)."""
        signed = [2 * patches.permute(0, 3, 1, 2) - 1 for patches in (prediction, target)]
        distances: Tensor = self.distance(*signed)
        return distances.mean()


def training_losses(
    prediction: Float[Tensor, "patches side side 3"],
    target: Float[Tensor, "patches side side 3"],
    skinning: Float[Tensor, ""],
    perceptual: Perceptual,
    weights: LossWeights,
) -> Losses:
    """All terms of one picture's patches.

    Args:
        prediction: rendered colours in [0, 1].
        target: the picture's colours on the same background.
        skinning: the skinning volume's distance from its prior; 0 where it is frozen.
        perceptual: the distance to train with.
        weights: of the terms.
    """
    distance = (
        perceptual(prediction, target)
        if weights.perceptual > 0
        else torch.zeros_like(prediction[0, 0, 0, 0])
    )
    squared = (prediction - target).square().mean()
    total = (
        weights.perceptual * distance
        + weights.squared_error * squared
        + weights.skinning * skinning
    )
    return Losses(total, distance, squared, skinning)
