"""The pose-dependent deformation on coarse canonical nodes: computed once a pose, read in between.

What each node's own input adds to the layers that see it is stored; so of the deformation network
only the pose's share and the layers in between are left to compute, for a few thousand nodes.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from actorsnerf_model.baked.bricks import read_corners
from actorsnerf_model.deformation import POSE_NUMBERS


@dataclass(frozen=True)
class Layer:
    """A linear layer, split by what it reads."""

    weight: Float[Tensor, "out hidden"]
    """Of the previous layer's result; no columns in the first."""
    pose: Float[Tensor, "out numbers"]
    """Of the pose; no columns where it is not read."""
    bias: Float[Tensor, "out"]


@dataclass(frozen=True)
class OffsetNodes:
    """A deformation network tied to nodes."""

    low: Float[Tensor, "3"]
    """Place of the first node, canonical frame, metres."""
    spacing: float
    """Of the nodes, metres."""
    sizes: tuple[int, int, int]
    """Nodes along z, y, x."""
    nodes: Int[Tensor, "nodes"]
    """Which nodes are kept, int32, counted along x, then y, then z; elsewhere nothing moves."""
    given: Float[Tensor, "reads nodes width"]
    """What each node adds to the layers that read it, in order; float16 on file."""
    readers: tuple[int, ...]
    """Which layers those are."""
    layers: tuple[Layer, ...]
    """Hidden layers, and the last one that gives offsets in metres."""
    mean: Float[Tensor, "nodes 3"]
    """Offsets over the poses that the actor was baked in, metres; already in the baked field."""


@torch.no_grad()
def offsets_in_pose(nodes: OffsetNodes, pose: Float[Tensor, "24 3"]) -> Float[Tensor, "nodes 3"]:
    """Every kept node's offset in a pose beyond its mean offset, metres.

    Args:
        nodes: of the actor.
        pose: axis-angle; the root is ignored.
    """
    numbers = pose[1:].reshape(POSE_NUMBERS)
    hidden = nodes.given[0, :, :0]
    for number, layer in enumerate(nodes.layers):
        bias = layer.bias + layer.pose @ numbers if layer.pose.numel() else layer.bias
        total = F.linear(hidden, layer.weight, bias)
        if number in nodes.readers:
            total = total + nodes.given[nodes.readers.index(number)]
        hidden = F.relu(total) if number + 1 < len(nodes.layers) else total
    return hidden - nodes.mean


def offset_volume(
    nodes: OffsetNodes, offsets: Float[Tensor, "nodes 3"]
) -> Float[Tensor, "3 z y x"]:
    """The offsets of `offsets_in_pose` at their places, zero elsewhere and one node around all."""
    z, y, x = nodes.sizes
    number = nodes.nodes.long()
    inner = number + 2 * (number // x) + (2 * (x + 2)) * (number // (x * y))
    volume = offsets.new_zeros(3, (z + 2) * (y + 2) * (x + 2))
    volume[:, inner + ((y + 2) * (x + 2) + (x + 2) + 1)] = offsets.T
    return volume.reshape(3, z + 2, y + 2, x + 2)


def offsets_at(
    points: Float[Tensor, "3 points"], nodes: OffsetNodes, volume: Float[Tensor, "3 z y x"]
) -> Float[Tensor, "3 points"]:
    """Offsets between the nodes, metres; zero away from them.

    Args:
        points: canonical frame, metres.
        nodes: of the actor.
        volume: of `offset_volume`.
    """
    shape = volume.shape[1:]
    share, first = [], None
    for axis in (2, 1, 0):
        size = shape[2 - axis]
        place = (points[axis] - nodes.low[axis]) / nodes.spacing + 1
        place = place.clamp(0, size - 1)
        cell = place.floor().clamp(max=size - 2)
        share.append(place - cell)
        first = cell if first is None else first * size + cell
    assert first is not None
    strides = (shape[1] * shape[2], shape[2], 1)
    return read_corners(volume.reshape(3, -1), first.int(), torch.stack(share[::-1]), strides)


__all__ = ["Layer", "OffsetNodes", "offset_volume", "offsets_at", "offsets_in_pose"]
