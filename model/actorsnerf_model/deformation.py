"""The deformation network: from the category's canonical space to the instance's (paper sec. 3.4).

x_i = x_c + D(annealed encoding of x_c, pose, pixel-aligned features of the K support views).
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_model.fourier import annealed_fourier_features
from actorsnerf_model.pieces import tiles

POSE_NUMBERS = 69
"""Axis-angle of joints 1 to 23; the root is folded into the camera."""
LAST_LAYER_BOUND = 1e-5
"""Weights of the last layer start uniform within this, so offsets start near zero."""


@dataclass(frozen=True)
class DeformationConfig:
    """Sizes of the deformation network; defaults are the released code's."""

    width: int = 128
    depth: int = 6
    """Hidden layers."""
    skip: int = 4
    """The whole input joins again before this layer (counted from 0)."""
    octaves: int = 6
    code: int = 64
    """Numbers that each support view's pixel feature is reduced to."""


class Deformation(nn.Module):
    """Offsets in normalised canonical coordinates.

    The released code adds 0.01 to each pose number; a layer's bias can do the same, so we do not.
    """

    def __init__(self, config: DeformationConfig, pixel_channels: int, views: int) -> None:
        """Random weights; `pixel_channels` 0 leaves the pixel-aligned features out."""
        super().__init__()
        self.octaves = config.octaves
        self.skip = config.skip
        self.views = views
        self.pixel_code = nn.Linear(pixel_channels, config.code) if pixel_channels else None
        self.point_features = 6 * config.octaves + (views * config.code if pixel_channels else 0)
        given = self.point_features + POSE_NUMBERS
        self.hidden = nn.ModuleList(
            nn.Linear(
                (config.width if i else 0) + (given if i in (0, config.skip) else 0), config.width
            )
            for i in range(config.depth)
        )
        self.offset = nn.Linear(config.width, 3)
        self._initialise()

    def _initialise(self) -> None:
        for layer in self.hidden:
            assert isinstance(layer, nn.Linear)
            nn.init.xavier_uniform_(layer.weight, gain=nn.init.calculate_gain("relu"))
            nn.init.zeros_(layer.bias)
        nn.init.uniform_(self.offset.weight, -LAST_LAYER_BOUND, LAST_LAYER_BOUND)
        nn.init.zeros_(self.offset.bias)

    def forward(
        self,
        points: Float[Tensor, "points 3"],
        opened: float,
        pose: Float[Tensor, "24 3"],
        pixels: Float[Tensor, "views points channels"] | None,
    ) -> Float[Tensor, "points 3"]:
        """Offsets of the points, in the published order: all that follows computes the same.

        Args:
            points: canonical, normalised to [-1, 1].
            opened: open octaves of the encoding.
            pose: axis-angle; the root is ignored. Repeated for every point.
            pixels: the support views' features at the points, in the encoder's channels.
        """
        parts = [annealed_fourier_features(points, self.octaves, opened)]
        if self.pixel_code is not None:
            assert pixels is not None
            parts.extend(self.pixel_code(pixels).unbind(0))
        parts.append(pose[1:].reshape(1, POSE_NUMBERS).expand(points.shape[0], -1))
        hidden = given = torch.cat(parts, dim=1)
        for i, layer in enumerate(self.hidden):
            if i == self.skip:
                hidden = torch.cat([hidden, given], dim=1)
            hidden = F.relu(layer(hidden))
        offsets: Tensor = self.offset(hidden)
        return offsets

    def from_input(
        self, given: Float[Tensor, "points given"], pose: Float[Tensor, "24 3"]
    ) -> Float[Tensor, "points 3"]:
        """The offsets of points in a pose from their `point_input`, which no pose changes.

        What the pose and the codes' bias add to a layer is computed once, not per point.
        """
        alike = torch.cat([self.code_biases(), pose[1:].reshape(POSE_NUMBERS)])
        layers = self._posed_layers(alike)
        return torch.cat([self._onward(given[rows], layers) for rows in tiles(given)])

    def code_biases(self) -> Float[Tensor, "codes"]:
        """What `point_input` leaves out of its last numbers: the bias of each view's code."""
        if self.pixel_code is None:
            return self.offset.bias[:0]
        return self.pixel_code.bias.repeat(self.views)

    def _posed_layers(self, alike: Float[Tensor, "numbers"]) -> list[tuple[Tensor, Tensor]]:
        """Weights and biases of the hidden layers; in the biases what `alike` adds.

        That is the end of the layers' input that all points have in common.
        """
        layers = []
        for i, layer in enumerate(self.hidden):
            assert isinstance(layer, nn.Linear)
            weight: Tensor = layer.weight
            bias: Tensor = layer.bias
            if i in (0, self.skip):
                bias = F.linear(alike, weight[:, -alike.shape[0] :], bias)
                weight = weight[:, :-POSE_NUMBERS]
            layers.append((weight, bias))
        return layers

    def _onward(
        self, given: Float[Tensor, "points given"], layers: list[tuple[Tensor, Tensor]]
    ) -> Float[Tensor, "points 3"]:
        hidden = given
        for i, (weight, bias) in enumerate(layers):
            if i == self.skip:
                width = hidden.shape[1]
                again = F.linear(given, weight[:, width:], bias)
                hidden = F.relu_(torch.addmm(again, hidden, weight[:, :width].t()))
            else:
                hidden = F.relu_(F.linear(hidden, weight, bias))
        offsets: Tensor = self.offset(hidden)
        return offsets

    def point_input(
        self,
        points: Float[Tensor, "points 3"],
        opened: float,
        codes: Float[Tensor, "views points code"] | None,
    ) -> Float[Tensor, "points given"]:
        """What the layers read of points besides the pose.

        Args:
            points: canonical, normalised to [-1, 1].
            opened: open octaves of the encoding.
            codes: pixel features already through `pixel_code.weight`, without its bias: that is
                what lets the linear layer run on the feature map, before interpolation. The bias is
                the same for all points, and `from_input` adds it.
        """
        parts = [annealed_fourier_features(points, self.octaves, opened)]
        if self.pixel_code is not None:
            assert codes is not None
            parts.extend(codes.unbind(0))
        return torch.cat(parts, dim=1)
