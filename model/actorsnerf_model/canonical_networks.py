"""HumanNeRF's three networks: pose refiner, non-rigid motion, canonical field.

Source: HumanNeRF (Weng et al., CVPR 2022) and its released code's sizes. Canonical points go in as
metres, not normalised.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_model.deformation import LAST_LAYER_BOUND, POSE_NUMBERS
from actorsnerf_model.fourier import annealed_fourier_features, fourier_features
from actorsnerf_model.radiance import positive_density
from actorsnerf_model.rotations import matrix_from_axis_angle


@dataclass(frozen=True)
class RefinerConfig:
    """Sizes of the pose refiner."""

    width: int = 256
    depth: int = 4
    """Hidden layers."""


class PoseRefiner(nn.Module):
    """Corrects the fitted pose: each joint but the root gets one more rotation.

    Biases begin at zero (HumanNeRF's released code), so an exactly zero pose passes the hidden
    layers as zeros, and no gradient reaches them from it (a ReLU's slope at 0 counts as 0). It
    reaches the last layer's biases, which are all of that pose's correction, through rotations that
    are smooth at 0: the pose is corrected from the first step on. The hidden layers learn from any
    other pose, and once they have, from this one.
    """

    def __init__(self, config: RefinerConfig) -> None:
        """Random weights; the corrections start near zero."""
        super().__init__()
        self.hidden = nn.ModuleList(
            nn.Linear(config.width if i else POSE_NUMBERS, config.width)
            for i in range(config.depth)
        )
        self.correction = nn.Linear(config.width, POSE_NUMBERS)
        _rectified(self.hidden)
        _small(self.correction)

    def forward(self, pose: Float[Tensor, "24 3"]) -> Float[Tensor, "24 3 3"]:
        """Local rotations of the corrected pose, R_b dR_b; the root keeps its own."""
        hidden = pose[1:].reshape(POSE_NUMBERS)
        for layer in self.hidden:
            hidden = F.relu(layer(hidden))
        turns = self.correction(hidden).reshape(23, 3).to(pose.dtype)
        turns = torch.cat([torch.zeros_like(pose[:1]), turns])
        with torch.autocast(pose.device.type, enabled=False):
            return matrix_from_axis_angle(pose) @ matrix_from_axis_angle(turns)


@dataclass(frozen=True)
class MotionConfig:
    """Sizes of the non-rigid motion."""

    width: int = 128
    depth: int = 6
    """Hidden layers."""
    skip: int = 4
    """The encoding, without the pose, joins again before this layer (counted from 0)."""
    octaves: int = 6


class NonRigidMotion(nn.Module):
    """Offsets of canonical points that no bone explains, metres."""

    def __init__(self, config: MotionConfig) -> None:
        """Random weights; the offsets start near zero."""
        super().__init__()
        self.config = config
        encoded = 6 * config.octaves
        sizes = [config.width] * config.depth
        sizes[0] = encoded + POSE_NUMBERS
        sizes[config.skip] += encoded
        self.hidden = nn.ModuleList(nn.Linear(size, config.width) for size in sizes)
        self.offset = nn.Linear(config.width, 3)
        _rectified(self.hidden)
        _small(self.offset)

    def forward(
        self, points: Float[Tensor, "points 3"], opened: float, pose: Float[Tensor, "24 3"]
    ) -> Float[Tensor, "points 3"]:
        """Offsets of the points; the pose's share of the first layer is computed once.

        Args:
            points: canonical, metres.
            opened: open octaves of the encoding.
            pose: axis-angle; the root is ignored.
        """
        encoded = annealed_fourier_features(points, self.config.octaves, opened)
        first, *others = self.hidden
        assert isinstance(first, nn.Linear)
        split = encoded.shape[1]
        held = F.linear(pose[1:].reshape(POSE_NUMBERS), first.weight[:, split:], first.bias)
        hidden = F.relu(F.linear(encoded, first.weight[:, :split], held))
        for number, layer in enumerate(others, start=1):
            if number == self.config.skip:
                hidden = torch.cat([encoded.to(hidden.dtype), hidden], dim=1)
            hidden = F.relu(layer(hidden))
        offsets: Tensor = self.offset(hidden)
        return offsets


@dataclass(frozen=True)
class CanonicalConfig:
    """Sizes of the canonical field."""

    width: int = 256
    depth: int = 8
    """Hidden layers."""
    skip: int = 5
    """The encoding joins again before this layer (counted from 0)."""
    octaves: int = 10
    density: Literal["relu", "softplus"] = "relu"
    """As in `RadianceConfig`."""
    density_scale: float = 1.0
    density_shift: float = 0.0


class CanonicalField(nn.Module):
    """Colour and density of the actor's canonical space."""

    def __init__(self, config: CanonicalConfig) -> None:
        """Random weights."""
        super().__init__()
        self.config = config
        encoded = 3 * (2 * config.octaves + 1)
        sizes = [config.width] * config.depth
        sizes[0] = encoded
        sizes[config.skip] += encoded
        self.hidden = nn.ModuleList(nn.Linear(size, config.width) for size in sizes)
        self.out = nn.Linear(config.width, 4)
        _rectified(self.hidden)
        nn.init.xavier_uniform_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(
        self, points: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points"]]:
        """Colour in (0, 1) and density in 1/metre at canonical points, metres."""
        encoded = fourier_features(points, self.config.octaves, identity=True)
        hidden = encoded
        for number, layer in enumerate(self.hidden):
            if number == self.config.skip:
                hidden = torch.cat([encoded.to(hidden.dtype), hidden], dim=1)
            hidden = F.relu(layer(hidden))
        raw = self.out(hidden).to(points.dtype)
        return torch.sigmoid(raw[:, :3]), positive_density(raw[:, 3], self.config)


def _rectified(layers: nn.ModuleList) -> None:
    for layer in layers:
        assert isinstance(layer, nn.Linear)
        nn.init.xavier_uniform_(layer.weight, gain=nn.init.calculate_gain("relu"))
        nn.init.zeros_(layer.bias)


def _small(layer: nn.Linear) -> None:
    nn.init.uniform_(layer.weight, -LAST_LAYER_BOUND, LAST_LAYER_BOUND)
    nn.init.zeros_(layer.bias)
