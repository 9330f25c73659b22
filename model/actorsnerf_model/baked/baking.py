"""How an actor is baked: its field on a sparse grid, its deformation on coarse nodes.

With fixed support views radiance depends on the category's point (which reads the pictures) and on
the instance's point, where the pose's deformation takes it. Baked is the field of category points
moved by their mean deformation in the support poses. In a pose, a share of the deformation beyond
the mean moves the place that is looked up, and pixel features move with it, which they should not:
the share is the one that comes nearest to the field in the support poses.
"""

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked.actor import BakedActorData
from actorsnerf_model.baked.bricks import CELLS, LEAST_DENSITY, SIDE, BrickGrid, encode
from actorsnerf_model.baked.offset_nodes import (
    Layer,
    OffsetNodes,
    offsets_in_pose,
)
from actorsnerf_model.deformation import POSE_NUMBERS, Deformation
from actorsnerf_model.interpolation import trilinear
from actorsnerf_model.skinning import SkinningVolume, nodes_from_canonical
from actorsnerf_model.states import Field

POINTS_AT_ONCE = 16384
"""Points through the networks together."""
FOLLOWS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Shares of the deformation that are tried."""
FOLLOW_POINTS = 2048
"""Points that they are tried on."""
REACH = 0.25
"""Share of the threshold: where the canonical body's own likelihood is lower, nothing is baked. In
another pose bones meet other neighbours, so this looks beyond the canonical shell."""


@dataclass(frozen=True)
class BakeOptions:
    """How fine an actor is baked."""

    voxel: float = 0.006
    """Distance between the nodes of colour and density, metres."""
    offset_spacing: float = 0.04
    """Distance between the nodes of the deformation, metres."""
    threshold: float = 0.01
    """Foreground likelihood below which there is nothing (as in `RenderOptions`)."""


@dataclass(frozen=True)
class BakeReport:
    """How well the baked parts represent what they were made of."""

    bricks: int
    bytes: int
    """Of the grid."""
    offset_nodes: int
    slide: float
    """Root mean square distance of the poses' offsets from their mean, metres: how far pixel
    features slide under the surface."""
    follow: float
    """Share of the deformation beyond the mean that moves the place that is looked up."""


@dataclass(frozen=True)
class _Nodes:
    """The nodes of the colour grid at which the field is asked."""

    low: Float[Tensor, "3"]
    asked: Bool[Tensor, "z y x"]
    """Whole bricks and one node more along every axis."""
    points: Float[Tensor, "asked 3"]
    """Category points, metres."""


@torch.no_grad()
def bake(
    method: ActorsNeRF,
    actor: ActorsNeRFState,
    supports: tuple[View, ...],
    options: BakeOptions,
) -> tuple[BakedActorData, BakeReport]:
    """The baked actor, and how well it represents the method's.

    Args:
        method: in evaluation mode.
        actor: its state.
        supports: the views that the state was made of; the mean deformation in their poses ties
            instance points to category points.
        options: how fine.
    """
    poses = torch.stack([view.pose for view in supports])
    nodes = _nodes(actor, options)
    rgb, density = _field(method, actor, poses, nodes)
    grid = _bricks(nodes, rgb, density, options.voxel)
    filled = nodes.points[density > LEAST_DENSITY]
    offsets = _offset_nodes(method, actor, poses, filled, options)
    slide, follow = 0.0, 0.0
    if offsets is not None and offsets.nodes.numel():
        moved = torch.stack([offsets_in_pose(offsets, pose) for pose in poses])
        slide = float(moved.square().sum(-1).mean().sqrt())
        follow = _best_follow(method, actor, poses, filled, options.voxel)
        offsets = _scaled(offsets, follow)
    skinning = replace(actor.body.skinning, weights=actor.body.skinning.weights.half().float())
    joints = actor.body.geometry.canonical_joints
    home = supports[0]
    data = BakedActorData(
        joints, skinning, offsets, grid, options.threshold, home.pose, home.rest_joints
    )
    count = 0 if offsets is None else offsets.nodes.shape[0]
    return data, BakeReport(grid.codes.shape[0], grid.bytes, count, slide, follow)


def _offset_nodes(
    method: ActorsNeRF,
    actor: ActorsNeRFState,
    poses: Float[Tensor, "poses 24 3"],
    filled: Float[Tensor, "filled 3"],
    options: BakeOptions,
) -> OffsetNodes | None:
    """The deformation at every node of a cell near something."""
    low, high = actor.body.geometry.box
    spacing = options.offset_spacing
    sizes = _sizes(actor.body.geometry.box, spacing)
    kept = _near(filled, low, spacing, sizes).reshape(-1).nonzero()[:, 0]
    points = _places(low, spacing, sizes).reshape(-1, 3)[kept]
    pieces = [method.deformation_input(actor, part) for part in torch.split(points, POINTS_AT_ONCE)]
    inputs = [piece for piece in pieces if piece is not None]
    if method.deformation is None or not inputs:
        return None
    layers, given = _split_layers(method.deformation, torch.cat(inputs), (high - low) / 2)
    readers = (0, method.deformation.skip)
    nodes = OffsetNodes(
        low, spacing, sizes, kept.int(), given, readers, layers, torch.zeros_like(points)
    )
    mean = torch.stack([offsets_in_pose(nodes, pose) for pose in poses]).mean(0)
    return replace(nodes, mean=mean)


def _best_follow(
    method: ActorsNeRF,
    actor: ActorsNeRFState,
    poses: Float[Tensor, "poses 24 3"],
    filled: Float[Tensor, "filled 3"],
    length: float,
) -> float:
    """The share of the deformation that comes nearest to the field in the support poses.

    Following all of it keeps position and body features right, following none of it keeps pixel
    features right; what matters more depends on the actor, so it is tried on points of it. Compared
    is what a stretch of the given length (metres) looks like: its colour times its opacity, and
    its opacity.
    """
    stride = -(-filled.shape[0] // FOLLOW_POINTS)
    points = filled[::stride]
    error = torch.zeros(len(FOLLOWS))
    for pose in poses:
        exact = _look(method.mean_field(actor, points, pose[None]), length)
        beyond = method.offsets(actor, points, pose[None]) - method.offsets(actor, points, poses)
        for number, share in enumerate(FOLLOWS):
            looked_up = method.mean_field(actor, points + share * beyond, poses)
            error[number] += float((_look(looked_up, length) - exact).square().mean())
    return FOLLOWS[int(error.argmin())]


def _look(values: Field, length: float) -> Float[Tensor, "points 4"]:
    opacity = -torch.expm1(-values.density.float() * length)[:, None]
    return torch.cat([values.rgb.float() * opacity, opacity], -1)


def _scaled(nodes: OffsetNodes, share: float) -> OffsetNodes:
    last = nodes.layers[-1]
    less = Layer(last.weight * share, last.pose, last.bias * share)
    return replace(nodes, layers=(*nodes.layers[:-1], less), mean=nodes.mean * share)


def _split_layers(
    network: Deformation, inputs: Float[Tensor, "nodes given"], metres: Float[Tensor, "3"]
) -> tuple[tuple[Layer, ...], Float[Tensor, "2 nodes width"]]:
    """The network's layers split by what they read, and the nodes' own share of two of them."""
    layers, given = [], []
    codes = network.code_biases().detach().float()
    inputs = inputs.float() + F.pad(codes, (inputs.shape[1] - codes.shape[0], 0))
    for number, module in enumerate([*network.hidden, network.offset]):
        assert isinstance(module, torch.nn.Linear)
        weight, bias = module.weight.detach().float(), module.bias.detach().float()
        pose = weight[:, :0]
        if number in (0, network.skip):
            weight, pose = weight[:, :-POSE_NUMBERS], weight[:, -POSE_NUMBERS:]
            before = weight.shape[1] - inputs.shape[1]
            given.append((inputs @ weight[:, before:].T).half().float())
            weight = weight[:, :before]
        layers.append(Layer(weight.contiguous(), pose.contiguous(), bias))
    last = layers[-1]
    layers[-1] = Layer(last.weight * metres[:, None], last.pose, last.bias * metres)
    return tuple(layers), torch.stack(given)


def _nodes(actor: ActorsNeRFState, options: BakeOptions) -> _Nodes:
    """The nodes that the body may touch, and those beside them."""
    box = actor.body.geometry.box
    bricks = [-(-(size - 1) // CELLS) for size in _sizes(box, options.voxel)]
    sizes = (bricks[0] * CELLS + 1, bricks[1] * CELLS + 1, bricks[2] * CELLS + 1)
    likely = []
    for layer in range(sizes[0]):
        points = _places(box[0], options.voxel, sizes, layer).reshape(-1, 3)
        likely.append(_likelihood(points, actor.body.skinning))
    asked = _wider(torch.stack(likely).reshape(sizes) >= REACH * options.threshold)
    z, y, x = asked.nonzero().unbind(-1)
    points = box[0] + torch.stack([x, y, z], -1).to(box) * options.voxel
    return _Nodes(box[0], asked, points)


def _field(
    method: ActorsNeRF,
    actor: ActorsNeRFState,
    poses: Float[Tensor, "poses 24 3"],
    nodes: _Nodes,
) -> tuple[Float[Tensor, "asked 3"], Float[Tensor, "asked"]]:
    rgb, density = [], []
    for part in torch.split(nodes.points, POINTS_AT_ONCE):
        values = method.mean_field(actor, part, poses)
        rgb.append(values.rgb.float())
        density.append(values.density.float())
    return torch.cat(rgb), torch.cat(density)


def _bricks(
    nodes: _Nodes, rgb: Float[Tensor, "asked 3"], density: Float[Tensor, "asked"], voxel: float
) -> BrickGrid:
    """The bricks that hold any density."""
    row = torch.full(nodes.asked.shape, -1, dtype=torch.int32, device=rgb.device)
    row[nodes.asked] = torch.arange(rgb.shape[0], dtype=torch.int32, device=rgb.device)
    filled = torch.zeros(nodes.asked.shape, device=rgb.device)
    filled[nodes.asked] = (density > LEAST_DENSITY).float()
    bricks = F.max_pool3d(filled[None, None], SIDE, CELLS)[0, 0] > 0
    place = bricks.nonzero()
    step = torch.arange(SIDE, device=rgb.device)
    z, y, x = (place[:, axis, None] * CELLS + step for axis in range(3))
    rows = row[z[:, :, None, None], y[:, None, :, None], x[:, None, None, :]]
    rows = rows.reshape(-1, SIDE**3).long()
    values = torch.cat([rgb, density[:, None]], -1)
    values = torch.cat([values, torch.zeros_like(values[:1])])[rows]  # -1: the last, empty row
    codes, top = encode(values[..., :3], values[..., 3])
    index = torch.full(bricks.shape, -1, dtype=torch.int32, device=rgb.device)
    index[bricks] = torch.arange(place.shape[0], dtype=torch.int32, device=rgb.device)
    return BrickGrid(nodes.low, voxel, index, codes, top)


def _near(
    points: Float[Tensor, "points 3"],
    low: Float[Tensor, "3"],
    spacing: float,
    sizes: tuple[int, int, int],
) -> Bool[Tensor, "z y x"]:
    """The nodes of cells that hold one of the points."""
    used = torch.zeros([size + 1 for size in sizes], device=points.device)
    x, y, z = ((points - low) / spacing).floor().long().unbind(-1)
    used[z + 1, y + 1, x + 1] = 1
    return F.max_pool3d(used[None, None], 2, 1)[0, 0] > 0


def _likelihood(
    points: Float[Tensor, "points 3"], volume: SkinningVolume
) -> Float[Tensor, "points"]:
    """Of the body in the canonical pose."""
    total = volume.weights.sum(0)[..., None]
    return trilinear(total, nodes_from_canonical(points, volume))[:, 0]


def _sizes(box: Float[Tensor, "2 3"], spacing: float) -> tuple[int, int, int]:
    """Nodes along z, y, x whose cells cover a box."""
    x, y, z = (torch.ceil((box[1] - box[0]) / spacing).long() + 1).tolist()
    return z, y, x


def _places(
    low: Float[Tensor, "3"], spacing: float, sizes: tuple[int, int, int], layer: int | None = None
) -> Float[Tensor, "z y x 3"]:
    """Where nodes are, metres; of one layer along z, or of all."""
    axes = [torch.arange(size, device=low.device) for size in sizes]
    if layer is not None:
        axes[0] = axes[0][layer : layer + 1]
    z, y, x = torch.meshgrid(*axes, indexing="ij")
    return low + torch.stack([x, y, z], -1).to(low) * spacing


def _wider(mask: Bool[Tensor, "z y x"]) -> Bool[Tensor, "z y x"]:
    """True also beside what is true."""
    return F.max_pool3d(mask[None, None].float(), 3, 1, 1)[0, 0] > 0


__all__ = ["BakeOptions", "BakeReport", "bake"]
