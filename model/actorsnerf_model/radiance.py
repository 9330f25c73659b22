"""The rendering network: features and position in, colour and density out (paper sec. 3.5).

`Radiance.forward` is the published order of operations, which the reference renderer asks for. The
other methods compute the same function with fewer products: the pixel layer runs on the feature
map, before interpolation; the body branch runs once, not once a view; where a linear layer comes
before the mean over views, the mean comes first; and colour, which the density does not read, is
its own branch, for the points that can be seen.
"""

import functools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_model.fourier import fourier_features
from actorsnerf_model.pieces import tiles


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


@dataclass(frozen=True)
class PointFeatures:
    """What the density and the colour of points are made from."""

    position: Float[Tensor, "points position"]
    """Encoded."""
    pixels: Float[Tensor, "views points code"] | None
    """Each support view's pixel features, reduced, but for their bias and ReLU."""
    body: Float[Tensor, "points code"] | None
    """SMPL features, reduced."""

    def chosen(self, which: Int[Tensor, "some"] | slice) -> "PointFeatures":
        """Those of some of the points."""
        pixels = None if self.pixels is None else self.pixels[:, which]
        body = None if self.body is None else self.body[which]
        return PointFeatures(self.position[which], pixels, body)


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
        pixels: Float[Tensor, "views points channels"] | None,
        body: Float[Tensor, "points body"] | None,
    ) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points"]]:
        """Colour in (0, 1) and density in 1/metre, in the published order of operations.

        Every view takes its own row through every layer until the means; `features`, `density` and
        `colour` compute the same.

        Args:
            points: instance space, normalised to [-1, 1].
            pixels: the support views' features, in the encoder's channels.
            body: body features at the points.
        """
        views = 1 if pixels is None else pixels.shape[0]
        position = fourier_features(points, self.config.octaves, identity=True)
        position = position.expand(views, -1, -1)
        read = []
        if self.body is not None:
            assert body is not None
            read.append(F.relu(self.body(body.expand(views, -1, -1))))
        if self.pixel is not None:
            assert pixels is not None
            read.append(F.relu(self.pixel(pixels)))
        given = torch.cat(read, dim=-1) if read else position
        hidden = torch.cat([F.relu(self.density_0(given)), position], dim=-1)
        hidden = F.relu(self.density_1(hidden).mean(dim=0))
        hidden = F.relu(self.density_3(F.relu(self.density_2(hidden))))
        density = positive_density(self.density_out(hidden)[:, 0], self.config)
        hidden = torch.cat([F.relu(self.colour_0(given)), position], dim=-1)
        hidden = F.relu(self.colour_2(F.relu(self.colour_1(hidden))).mean(dim=0))
        return torch.sigmoid(self.colour_out(F.relu(self.colour_3(hidden)))), density

    def features(
        self,
        points: Float[Tensor, "points 3"],
        pixels: Float[Tensor, "views points code"] | None,
        body: Float[Tensor, "points body"] | None,
    ) -> PointFeatures:
        """What both branches read.

        Args:
            points: instance space, normalised to [-1, 1].
            pixels: pixel features already through `pixel.weight`, without its bias.
            body: body features at the points.
        """
        position = fourier_features(points, self.config.octaves, identity=True)
        reduced = None
        if self.body is not None:
            assert body is not None
            reduced = F.relu_(self.body(body))
        return PointFeatures(position, pixels, reduced)

    def density(self, features: PointFeatures) -> Float[Tensor, "points"]:
        """Density in 1/metre."""
        parts = [self._density(features.chosen(rows)) for rows in tiles(features.position)]
        return positive_density(torch.cat(parts).to(features.position.dtype), self.config)

    def colour(self, features: PointFeatures) -> Float[Tensor, "points 3"]:
        """Colour in (0, 1)."""
        parts = [self._colour(features.chosen(rows)) for rows in tiles(features.position)]
        return torch.sigmoid(torch.cat(parts).to(features.position.dtype))

    def _density(self, features: PointFeatures) -> Float[Tensor, "points"]:
        summed, share = _summed(self._first_layer(self.density_0, features))
        placed, weight = self._placed(self.density_1, features)
        hidden = F.relu_(torch.addmm(placed, summed, weight, alpha=share))
        hidden = F.relu_(self.density_3(F.relu_(self.density_2(hidden))))
        raw: Tensor = self.density_out(hidden)[:, 0]
        return raw

    def _colour(self, features: PointFeatures) -> Float[Tensor, "points 3"]:
        placed, weight = self._placed(self.colour_1, features)
        views = self._first_layer(self.colour_0, features)
        summed, share = _summed(F.relu_(torch.addmm(placed, view, weight)) for view in views)
        layer = self.colour_2
        hidden = F.relu_(torch.addmm(layer.bias, summed, layer.weight.t(), alpha=share))
        raw: Tensor = self.colour_out(F.relu_(self.colour_3(hidden)))
        return raw

    def _placed(
        self, layer: nn.Linear, features: PointFeatures
    ) -> tuple[Float[Tensor, "points width"], Float[Tensor, "width width"]]:
        """What a layer makes of the position alone, and its weight for the rest of its input."""
        width = self.config.width
        placed = F.linear(features.position, layer.weight[:, width:], layer.bias)
        return placed, layer.weight[:, :width].t()

    def _first_layer(
        self, layer: nn.Linear, features: PointFeatures
    ) -> Iterator[Float[Tensor, "points width"]]:
        """First layer of a branch, view after view; the body's share is made once."""
        code = self.config.code
        if features.pixels is None:
            yield F.relu_(layer(features.position if features.body is None else features.body))
            return
        assert self.pixel is not None
        shared: Tensor = layer.bias
        if features.body is not None:
            shared = F.linear(features.body, layer.weight[:, :code], layer.bias)
        weight = layer.weight[:, -code:].t()
        for view in features.pixels:
            yield F.relu_(torch.addmm(shared, F.relu_(view + self.pixel.bias), weight))


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


def _summed(
    views: Iterable[Float[Tensor, "points width"]],
) -> tuple[Float[Tensor, "points width"], float]:
    """The views' sum, and what makes it their mean: the next layer's product takes it along."""
    each = list(views)
    return functools.reduce(torch.add, each), 1 / len(each)
