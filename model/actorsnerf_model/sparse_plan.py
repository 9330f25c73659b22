"""Which voxel meets which in a sparse convolution: fixed by a body's vertices, made once for them.

Level 0 are the voxels that hold a vertex; each further level halves the resolution and keeps every
voxel that a 3x3x3 kernel of stride 2 reaches from an active one. The centre of voxel v of level l
is `origin + v * voxel * 2**l`.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from actorsnerf_datasets.errors import UserError

OFFSETS = 27
"""Of a 3x3x3 kernel, ordered z, y, x; 13 is the centre."""


@dataclass(frozen=True)
class Pairs:
    """Source and target rows that meet under each kernel offset, in the order of the offsets."""

    source: Int[Tensor, "pairs"]
    target: Int[Tensor, "pairs"]
    counts: tuple[int, ...]
    """Pairs under each of the 27 offsets."""
    target_order: Int[Tensor, "pairs"]
    """The pairs sorted by target row."""
    target_starts: Int[Tensor, "targets"]
    """Where each target's pairs begin in that order."""
    source_order: Int[Tensor, "pairs"]
    source_starts: Int[Tensor, "sources"]


@dataclass(frozen=True)
class Merge:
    """Which voxel each vertex falls into; voxels take the mean of their vertices."""

    row: Int[Tensor, "vertices"]
    order: Int[Tensor, "vertices"]
    """The vertices sorted by voxel row."""
    starts: Int[Tensor, "rows"]
    shares: Float[Tensor, "rows"]
    """One over the number of vertices of each voxel."""


@dataclass(frozen=True)
class Level:
    """The active voxels of one resolution."""

    voxels: Int[Tensor, "rows 3"]
    """z, y, x; ascending."""
    shape: tuple[int, int, int]
    """Grid size, z, y, x."""
    same: Pairs
    """Of a submanifold convolution: active voxels only, in and out."""


@dataclass(frozen=True)
class SparsePlan:
    """All tables of the sparse convolutions around a body."""

    origin: Float[Tensor, "3"]
    """x, y, z of the centre of voxel 0, metres, frame of the vertices."""
    voxel: float
    """Edge of a voxel of level 0, metres."""
    merge: Merge
    levels: tuple[Level, ...]
    down: tuple[Pairs, ...]
    """From each level to the next, stride 2."""


def plan_sparse(
    vertices: Float[Tensor, "vertices 3"], box: Float[Tensor, "2 3"], voxel: float, levels: int
) -> SparsePlan:
    """The tables for an actor's vertices, at rest or posed; any number of them, on their device.

    Args:
        vertices: metres, canonical frame or posed body frame.
        box: lower and upper corner of a box around them; voxel 0 is centred on the lower corner.
        voxel: metres (released code: 0.005).
        levels: how many resolutions (released code: 4).

    Raises:
        UserError: a vertex lies outside the box.
    """
    extent = ((box[1] - box[0]) / voxel).ceil().long().flip(0)
    block = 2 ** (levels - 1)
    z, y, x = ((extent // block + 1) * block).tolist()
    shape = (z, y, x)
    coordinates = ((vertices - box[0]) / voxel).round().long().flip(1)
    if bool(((coordinates < 0) | (coordinates > extent)).any()):
        raise UserError(_outside(vertices, box))
    keys, row = torch.unique(_keys(coordinates, shape), sorted=True, return_inverse=True)
    made = [_level(keys, shape)]
    down = []
    for _ in range(1, levels):
        keys, smaller = _halved(made[-1])
        coarse = _level(keys, smaller)
        down.append(_pairs(made[-1], coarse.voxels, stride=2))
        made.append(coarse)
    return SparsePlan(box[0], voxel, _merge(row, made[0]), tuple(made), tuple(down))


def _outside(vertices: Float[Tensor, "vertices 3"], box: Float[Tensor, "2 3"]) -> str:
    """By how much a body is larger than its box, along which axis, and what may be the reason."""
    beyond = torch.maximum(box[0] - vertices, vertices - box[1])
    count, far = int((beyond > 0).any(1).sum()), beyond.amax(0)
    return (
        f"{count} of {len(vertices)} vertices lie outside the box around the rest joints, by up to "
        f"{float(far.max()):.3g} m along {'xyz'[int(far.argmax())]}; likely causes: by some "
        "centimetres, a body that is thicker than the spread of its joints allows for (the box has "
        "a margin in proportion to it); by more, vertices and joints that are not of the same "
        "actor, in metres, at rest. Check the prepared file with actorsnerf-datasets check"
    )


def _keys(voxels: Int[Tensor, "*batch 3"], shape: tuple[int, int, int]) -> Int[Tensor, "*batch"]:
    return (voxels[..., 0] * shape[1] + voxels[..., 1]) * shape[2] + voxels[..., 2]


def _level(keys: Int[Tensor, "rows"], shape: tuple[int, int, int]) -> Level:
    plane = shape[1] * shape[2]
    voxels = torch.stack([keys // plane, keys // shape[2] % shape[1], keys % shape[2]], dim=1)
    unpaired = Level(voxels, shape, _no_pairs(keys))
    return Level(voxels, shape, _pairs(unpaired, voxels, stride=1))


def _no_pairs(keys: Int[Tensor, "rows"]) -> Pairs:
    none = keys[:0]
    return Pairs(none, none, (), none, none, none, none)


def _halved(level: Level) -> tuple[Int[Tensor, "rows"], tuple[int, int, int]]:
    """Keys and grid of the next level: all voxels o with 2 o + d active, d in -1, 0, 1."""
    shape = (level.shape[0] // 2, level.shape[1] // 2, level.shape[2] // 2)
    reached = (level.voxels[:, None] - _kernel(level.voxels)).flatten(0, 1)
    halves = reached // 2
    limit = reached.new_tensor(shape)
    inside = ((reached % 2 == 0) & (reached >= 0) & (halves < limit)).all(dim=1)
    return torch.unique(_keys(halves[inside], shape), sorted=True), shape


def _kernel(like: Int[Tensor, "rows 3"]) -> Int[Tensor, "27 3"]:
    steps = torch.arange(-1, 2, device=like.device)
    return torch.cartesian_prod(steps, steps, steps)


def _pairs(source: Level, targets: Int[Tensor, "targets 3"], stride: int) -> Pairs:
    wanted = stride * targets + _kernel(targets)[:, None]
    inside = ((wanted >= 0) & (wanted < targets.new_tensor(source.shape))).all(dim=2)
    keys = _keys(source.voxels, source.shape)
    sought = _keys(wanted, source.shape)
    position = torch.searchsorted(keys, sought).clamp(max=len(keys) - 1)
    offset, target = (inside & (keys[position] == sought)).nonzero(as_tuple=True)
    found = position[offset, target]
    counts = tuple(torch.bincount(offset, minlength=OFFSETS).tolist())
    target_order, target_starts = _sorted_groups(target, len(targets))
    source_order, source_starts = _sorted_groups(found, len(keys))
    return Pairs(found, target, counts, target_order, target_starts, source_order, source_starts)


def _sorted_groups(
    group: Int[Tensor, "items"], groups: int
) -> tuple[Int[Tensor, "items"], Int[Tensor, "groups"]]:
    """The items in the order of their groups, and where each group begins."""
    order = torch.argsort(group, stable=True)
    sizes = torch.bincount(group, minlength=groups)
    return order, sizes.cumsum(0) - sizes


def _merge(row: Int[Tensor, "vertices"], level: Level) -> Merge:
    order, starts = _sorted_groups(row, len(level.voxels))
    sizes = torch.bincount(row, minlength=len(level.voxels))
    return Merge(row, order, starts, 1.0 / sizes)
