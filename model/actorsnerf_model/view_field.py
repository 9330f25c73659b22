"""Neural Body's two small networks: density from body features, colour with a view direction.

Source: Neural Body (Peng et al., CVPR 2021) and its released code's sizes. Between the density's
last hidden layer and the colour's first activation the released network has two linear layers
without activation; here the three matrices are multiplied first, which is the same function, and
the frame's share, the same for all points, is computed once.
"""

import math
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_model.fourier import fourier_features
from actorsnerf_model.radiance import positive_density


@dataclass(frozen=True)
class ViewFieldConfig:
    """Sizes of both networks; defaults are the released code's."""

    width: int = 256
    """Of three hidden layers."""
    colour_width: int = 128
    """Of the colour's last hidden layer."""
    latent: int = 128
    """Numbers that a frame has of its own."""
    octaves: int = 10
    """Of the position's encoding, which has the identity too."""
    direction_octaves: int = 4
    """Of the view direction's encoding, which has the identity too."""
    density: Literal["relu", "softplus"] = "relu"
    """As in `RadianceConfig`."""
    density_scale: float = 1.0
    density_shift: float = 0.0


class ViewField(nn.Module):
    """Colour in (0, 1) and density in the posed body's own space."""

    def __init__(self, config: ViewFieldConfig, features: int) -> None:
        """Random weights for `features` numbers per point."""
        super().__init__()
        self.config = config
        width = config.width
        position = 3 * (2 * config.octaves + 1)
        direction = 3 * (2 * config.direction_octaves + 1)
        self.density_0 = nn.Linear(features, width)
        self.density_1 = nn.Linear(width, width)
        self.density_2 = nn.Linear(width, width)
        self.density_out = nn.Linear(width, 1)
        self.feature = nn.Linear(width, width)
        self.framed = nn.Linear(width + config.latent, width)
        self.colour = nn.Linear(width + direction + position, config.colour_width)
        self.colour_out = nn.Linear(config.colour_width, 3)

    def hidden(self, features: Float[Tensor, "points features"]) -> Float[Tensor, "points width"]:
        """What density and colour share."""
        shared = F.relu(self.density_1(F.relu(self.density_0(features))))
        return F.relu(self.density_2(shared))

    def density(
        self, hidden: Float[Tensor, "points width"], dtype: torch.dtype
    ) -> Float[Tensor, "points"]:
        """Density, 1/metre, in the given precision."""
        return positive_density(self.density_out(hidden)[:, 0].to(dtype), self.config)

    def rgb(
        self,
        hidden: Float[Tensor, "points width"],
        points: Float[Tensor, "points 3"],
        directions: Float[Tensor, "points 3"] | None,
        latent: Float[Tensor, "latent"],
    ) -> Float[Tensor, "points 3"]:
        """Colour in (0, 1), in the points' precision.

        Args:
            hidden: of these points.
            points: posed body frame, metres, as they are.
            directions: from the camera, unit length; None gives the colour of the mean encoding
                over all directions.
            latent: of the frame.
        """
        width = self.config.width
        weight, bias = self._joined(latent)
        seen = self._encoded_directions(points, directions)
        place = fourier_features(points, self.config.octaves, identity=True)
        given = torch.cat([seen, place], -1).to(hidden.dtype)
        own = F.linear(given, self.colour.weight[:, width:])
        raw = self.colour_out(F.relu(F.linear(hidden, weight, bias) + own))
        return torch.sigmoid(raw.to(points.dtype))

    def _joined(
        self, latent: Float[Tensor, "latent"]
    ) -> tuple[Float[Tensor, "colour width"], Float[Tensor, "colour"]]:
        """Three linear layers in one, the frame's share in its bias."""
        width = self.config.width
        with torch.autocast(latent.device.type, enabled=False):
            onward = self.colour.weight[:, :width]
            framed = self.framed.weight
            held = framed[:, :width] @ self.feature.bias + framed[:, width:] @ latent
            bias = self.colour.bias + onward @ (held + self.framed.bias)
            return onward @ framed[:, :width] @ self.feature.weight, bias

    def _encoded_directions(
        self, points: Float[Tensor, "points 3"], directions: Float[Tensor, "points 3"] | None
    ) -> Float[Tensor, "points direction"]:
        octaves = self.config.direction_octaves
        if directions is not None:
            return fourier_features(directions, octaves, identity=True)
        return points.new_tensor(mean_direction(octaves)).expand(points.shape[0], -1)


def mean_direction(octaves: int) -> list[float]:
    """The mean encoding over all unit vectors: a coordinate of theirs is uniform in [-1, 1].

    >>> [round(value, 3) for value in mean_direction(1)]
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.841, 0.841, 0.841]
    """
    encoded = [0.0] * 3
    for octave in range(octaves):
        encoded += [0.0] * 3 + [math.sin(2.0**octave) / 2.0**octave] * 3
    return encoded


__all__ = ["ViewField", "ViewFieldConfig", "mean_direction"]
