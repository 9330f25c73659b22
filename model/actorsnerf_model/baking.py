"""How an actor is baked: its field on a sparse grid, its deformation on coarse nodes.

With fixed support views radiance depends on the category's point (which reads the pictures) and on
the instance's point, where the pose's deformation takes it. Baked is the field at instance points;
each is tied to the category point that the mean deformation of the support poses takes there.
"""

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked import BakedActorData
from actorsnerf_model.bricks import CELLS, LEAST_DENSITY, SIDE, BrickGrid, encode
from actorsnerf_model.deformation import POSE_NUMBERS, Deformation
from actorsnerf_model.interpolation import trilinear
from actorsnerf_model.offset_nodes import (
    Layer,
    OffsetNodes,
    offset_volume,
    offsets_at,
    offsets_in_pose,
)
from actorsnerf_model.skinning import SkinningVolume, nodes_from_canonical

POINTS_AT_ONCE = 16384
"""Points through the networks together."""
TIE_STEPS = 8
"""Fixed-point steps that find the category point of an instance point."""
REACH = 0.25
"""Share of the threshold: where the canonical body's own likelihood is lower, nothing is baked. In
another pose bones meet other neighbours, so this looks beyond the canonical shell."""


@dataclass(frozen=True)
class BakeOptions:
    """How fine an actor is baked."""

    voxel: float = 0.01
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
    tie_error: float
    """Median distance between an instance point and where its category point goes, metres."""
    slide: float
    """Root mean square distance between the support poses' offsets and their mean, metres: how far
    pixel features slide, which is what baking does not follow."""


@dataclass(frozen=True)
class _Tie:
    """The mean deformation of the support poses."""

    nodes: OffsetNodes
    volume: Float[Tensor, "z y x 3"]


@dataclass(frozen=True)
class _Nodes:
    """The nodes of the colour grid at which the field is asked."""

    low: Float[Tensor, "3"]
    asked: Bool[Tensor, "z y x"]
    """Whole bricks and one node more along every axis."""
    instance: Float[Tensor, "asked 3"]
    category: Float[Tensor, "asked 3"]


@torch.no_grad()
def bake(
    method: ActorsNeRF,
    actor: ActorsNeRFState,
    poses: Float[Tensor, "poses 24 3"],
    options: BakeOptions,
) -> tuple[BakedActorData, BakeReport]:
    """The baked actor, and how well it represents the method's.

    Args:
        method: in evaluation mode.
        actor: its state.
        poses: over whose deformations category and instance points are tied; the support poses.
        options: how fine.
    """
    offsets = _offset_nodes(method, actor, options)
    tie, slide = None, 0.0
    if offsets is not None:
        moved = torch.stack([offsets_in_pose(offsets, pose) for pose in poses])
        slide = float((moved - moved.mean(0)).square().sum(-1).mean().sqrt())
        tie = _Tie(offsets, offset_volume(offsets, moved.mean(0)))
    nodes = _nodes(actor, tie, options)
    rgb, density = _field(method, actor, nodes)
    grid = _bricks(nodes, rgb, density, options.voxel)
    tie_error = 0.0
    if tie is not None:
        kept = density > LEAST_DENSITY
        category = nodes.category[kept]
        missed = category + offsets_at(category, tie.nodes, tie.volume) - nodes.instance[kept]
        tie_error = float(missed.norm(dim=-1).square().mean().sqrt()) if category.numel() else 0.0
        offsets = _near(tie.nodes, category)
    skinning = replace(actor.body.skinning, weights=actor.body.skinning.weights.half().float())
    joints = actor.body.geometry.canonical_joints
    data = BakedActorData(joints, skinning, offsets, grid, options.threshold)
    count = 0 if offsets is None else offsets.nodes.shape[0]
    return data, BakeReport(grid.codes.shape[0], grid.bytes, count, tie_error, slide)


def _offset_nodes(
    method: ActorsNeRF, actor: ActorsNeRFState, options: BakeOptions
) -> OffsetNodes | None:
    """The deformation at every node of a cell that the canonical body may touch."""
    low, high = actor.body.geometry.box
    spacing = options.offset_spacing
    sizes = _sizes(actor.body.geometry.box, spacing)
    places = _places(low, spacing, sizes)
    likely = _likelihood(places.reshape(-1, 3), actor.body.skinning).reshape(sizes)
    kept = _wider(likely >= REACH * options.threshold).reshape(-1).nonzero()[:, 0]
    points = places.reshape(-1, 3)[kept]
    pieces = [method.deformation_input(actor, part) for part in points.split(POINTS_AT_ONCE)]
    inputs = [piece for piece in pieces if piece is not None]
    if method.deformation is None or not inputs:
        return None
    layers, given = _split_layers(method.deformation, torch.cat(inputs), (high - low) / 2)
    readers = (0, method.deformation.skip)
    return OffsetNodes(low, spacing, sizes, kept.int(), given, readers, layers)


def _split_layers(
    network: Deformation, inputs: Float[Tensor, "nodes given"], metres: Float[Tensor, "3"]
) -> tuple[tuple[Layer, ...], Float[Tensor, "2 nodes width"]]:
    """The network's layers split by what they read, and the nodes' own share of two of them."""
    layers, given = [], []
    for number, module in enumerate([*network.hidden, network.offset]):
        assert isinstance(module, torch.nn.Linear)
        weight, bias = module.weight.detach().float(), module.bias.detach().float()
        pose = weight[:, :0]
        if number in (0, network.skip):
            weight, pose = weight[:, :-POSE_NUMBERS], weight[:, -POSE_NUMBERS:]
            before = weight.shape[1] - inputs.shape[1]
            given.append((inputs.float() @ weight[:, before:].T).half().float())
            weight = weight[:, :before]
        layers.append(Layer(weight.contiguous(), pose.contiguous(), bias))
    last = layers[-1]
    layers[-1] = Layer(last.weight * metres[:, None], last.pose, last.bias * metres)
    return tuple(layers), torch.stack(given)


def _nodes(actor: ActorsNeRFState, tie: _Tie | None, options: BakeOptions) -> _Nodes:
    """The nodes whose category point the body may touch, and those beside them."""
    box = actor.body.geometry.box
    bricks = [-(-(size - 1) // CELLS) for size in _sizes(box, options.voxel)]
    sizes = (bricks[0] * CELLS + 1, bricks[1] * CELLS + 1, bricks[2] * CELLS + 1)
    likely = []
    for layer in range(sizes[0]):
        points = _places(box[0], options.voxel, sizes, layer).reshape(-1, 3)
        likely.append(_likelihood(_category_points(points, tie), actor.body.skinning))
    touched = torch.stack(likely).reshape(sizes) >= REACH * options.threshold
    asked = _wider(touched)
    z, y, x = asked.nonzero().unbind(-1)
    instance = box[0] + torch.stack([x, y, z], -1).to(box) * options.voxel
    parts = [_category_points(part, tie) for part in instance.split(1 << 18)]
    return _Nodes(box[0], asked, instance, torch.cat(parts))


def _category_points(
    points: Float[Tensor, "points 3"], tie: _Tie | None
) -> Float[Tensor, "points 3"]:
    """The points that the mean deformation takes to given instance points."""
    category = points
    for _ in range(TIE_STEPS if tie is not None else 0):
        assert tie is not None
        category = points - offsets_at(category, tie.nodes, tie.volume)
    return category


def _field(
    method: ActorsNeRF, actor: ActorsNeRFState, nodes: _Nodes
) -> tuple[Float[Tensor, "asked 3"], Float[Tensor, "asked"]]:
    rgb, density = [], []
    for first in range(0, nodes.instance.shape[0], POINTS_AT_ONCE):
        part = slice(first, first + POINTS_AT_ONCE)
        values = method.tied_field(actor, nodes.category[part], nodes.instance[part])
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


def _near(nodes: OffsetNodes, points: Float[Tensor, "points 3"]) -> OffsetNodes:
    """Only the nodes of cells that hold one of the points, and those beside them."""
    used = torch.zeros(nodes.sizes, device=points.device)
    last = torch.tensor(nodes.sizes[::-1], device=points.device) - 1
    cell = ((points - nodes.low) / nodes.spacing).round().long()
    x, y, z = cell.clamp(torch.zeros_like(last), last).unbind(-1)
    used[z, y, x] = 1
    keep = _wider(_wider(used > 0)).reshape(-1)[nodes.nodes.long()]
    return replace(nodes, nodes=nodes.nodes[keep], given=nodes.given[:, keep])


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
