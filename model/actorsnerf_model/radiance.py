"""The rendering network: features and position in, colour and density out (paper sec. 3.5).

It computes the released network's function with fewer products: the pixel layer runs on the
feature map, before interpolation; the body branch runs once, not once a view; and where a linear
layer comes before the mean over views, the mean comes first.
"""

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_model.fourier import fourier_features


@dataclass(frozen=True)
class RadianceConfig:
    """Sizes of the rendering network; defaults are the released code's."""

    width: int = 256
    code: int = 256
    """Numbers that each support view's pixel feature, and the body feature, is reduced to."""
    octaves: int = 10
    """Of the position's encoding, which has the identity too."""
    density: Literal["relu", "softplus"] = "relu"
    """What makes the raw density non-negative; softplus cannot die in a short training."""
    density_scale: float = 1.0
    """1/metre for one unit of activation."""
    density_shift: float = 0.0
    """Added to the raw density."""


class Radiance(nn.Module):
    """Colour in (0, 1) and density; no view direction, as released."""

    def __init__(self, config: RadianceConfig, pixel_channels: int, body_channels: int) -> None:
        """Random weights; 0 channels leave that kind of feature, and its layers, out."""
        super().__init__()
        self.config = config
        width, code = config.width, config.code
        position = 3 * (2 * config.octaves + 1)
        self.pixel = nn.Linear(pixel_channels, code) if pixel_channels else None
        self.body = nn.Linear(body_channels, code) if body_channels else None
        joined = code * ((self.pixel is not None) + (self.body is not None)) or position
        self.density_0 = nn.Linear(joined, width)
        self.density_1 = nn.Linear(width + position, width)
        self.density_2 = nn.Linear(width, width)
        self.density_3 = nn.Linear(width, width)
        self.density_out = nn.Linear(width, 1)
        self.colour_0 = nn.Linear(joined, width)
        self.colour_1 = nn.Linear(width + position, width)
        self.colour_2 = nn.Linear(width, width)
        self.colour_3 = nn.Linear(width, width)
        self.colour_out = nn.Linear(width, 3)

    def forward(
        self,
        points: Float[Tensor, "points 3"],
        pixels: Float[Tensor, "points views code"] | None,
        body: Float[Tensor, "points body"] | None,
    ) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points"]]:
        """Colour in (0, 1) and density in 1/metre.

        Args:
            points: instance space, normalised to [-1, 1].
            pixels: pixel features already through `pixel.weight`, without its bias.
            body: body features at the points.
        """
        width = self.config.width
        position = fourier_features(points, self.config.octaves, identity=True)
        joined = F.relu(self._joined(position, pixels, body))
        f_density, f_colour = joined[..., :width], joined[..., width:]
        density = F.relu(_two_inputs(self.density_1, f_density.mean(dim=1), position))
        density = F.relu(self.density_3(F.relu(self.density_2(density))))
        first = self.colour_1
        shared = F.linear(position, first.weight[:, width:], first.bias)
        per_view = F.relu(F.linear(f_colour, first.weight[:, :width]) + shared[:, None])
        colour = F.relu(self.colour_2(per_view.mean(dim=1)))
        colour = self.colour_out(F.relu(self.colour_3(colour)))
        raw = self.density_out(density)[:, 0]
        return torch.sigmoid(colour.to(points.dtype)), positive_density(
            raw.to(points.dtype), self.config
        )

    def _joined(
        self,
        position: Float[Tensor, "points position"],
        pixels: Float[Tensor, "points views code"] | None,
        body: Float[Tensor, "points body"] | None,
    ) -> Float[Tensor, "points views twice"]:
        """First layer of both branches at once, before its activation; the body's share once."""
        weight = torch.cat([self.density_0.weight, self.colour_0.weight])
        bias = torch.cat([self.density_0.bias, self.colour_0.bias])
        if self.pixel is None and self.body is None:
            return F.linear(position, weight, bias)[:, None]
        total: Tensor = bias
        if self.body is not None:
            assert body is not None
            share = F.relu(self.body(body))
            total = F.linear(share, weight[:, : self.config.code], bias)[:, None]
        if self.pixel is not None:
            assert pixels is not None
            seen = F.relu(pixels + self.pixel.bias)
            total = total + F.linear(seen, weight[:, -self.config.code :])
        return total


@runtime_checkable
class DensityConfig(Protocol):
    """How a raw output becomes a density."""

    @property
    def density(self) -> Literal["relu", "softplus"]:
        """What makes it non-negative."""

    @property
    def density_scale(self) -> float:
        """1/metre for one unit of activation."""

    @property
    def density_shift(self) -> float:
        """Added to the raw density."""


def positive_density(
    raw: Float[Tensor, "points"], config: DensityConfig
) -> Float[Tensor, "points"]:
    """The density, 1/metre, of a network's raw output."""
    shifted = raw + config.density_shift
    positive = F.relu(shifted) if config.density == "relu" else F.softplus(shifted)
    return positive * config.density_scale


def _two_inputs(
    layer: nn.Linear, first: Float[Tensor, "points a"], second: Float[Tensor, "points b"]
) -> Float[Tensor, "points out"]:
    return F.linear(torch.cat([first, second.to(first.dtype)], dim=-1), layer.weight, layer.bias)
