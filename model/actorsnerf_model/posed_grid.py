"""A baked actor's backward warp on a grid around the posed body: computed once per pose.

The warp is smooth where some bone holds the place, so between nodes it is interpolated. A node that
no bone holds has no say: nodes carry a weight of 1 or 0, and the sum is divided by the weights'.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from actorsnerf_model.bricks import (
    CELLS,
    SIDE,
    VISIBLE_DENSITY,
    BrickGrid,
    brick_table,
    density_from_activation,
)
from actorsnerf_model.interpolation import trilinear
from actorsnerf_model.occupancy import CELL
from actorsnerf_model.skinning import SkinningVolume, blend, nodes_from_canonical

LEAST_LIKELIHOOD = 1e-4
"""Below it no bone holds a place (the warp divides by no less); far below any threshold."""
LEAST_SHARE = 1e-3
"""Under the division by the weights of a cell's nodes."""


ANCHOR_SPACING = 0.02
"""Metres, at most; closer than the cells, so that no cell on a path is missed."""
GROWTH = 4
"""How often the grid may grow by a cell."""
PARTS = 2
"""Parts of a cell along each axis; each is stepped over if it reaches nothing."""


@dataclass(frozen=True)
class FilledVoxels:
    """Where in canonical space anything can be seen, and what is near it."""

    low: Float[Tensor, "3"]
    """Corner of the first cell, metres."""
    edge: float
    """Of the cells, metres."""
    cells: Bool[Tensor, "z y x"]
    """Those on the border are empty."""


@dataclass(frozen=True)
class Anchors:
    """Points of the filled canonical space that ride on the bones."""

    points: Float[Tensor, "points 3"]
    """Metres."""
    weights: Float[Tensor, "points 24"]
    """Of the bones; they sum to 1."""


@dataclass(frozen=True)
class PosedGrid:
    """Where points around a posed body lie in canonical space."""

    low: Float[Tensor, "3"]
    """Place of the first node, posed body frame, metres."""
    spacing: float
    """Of the nodes, metres."""
    sizes: tuple[int, int, int]
    """Nodes along x, y, z."""
    rows: Float[Tensor, "nodes 5"]
    """The place that is looked up (metres), 1, and the likelihood; zeros where no bone is. The last
    axis is the fastest."""
    live: Bool[Tensor, "px py pz"]
    """Which parts of cells, `PARTS` along each axis, can show anything."""
    parts: Int[Tensor, "live 3"]
    """Those, x, y, z."""


@torch.no_grad()
def filled_voxels(grid: BrickGrid, reach: float) -> FilledVoxels:
    """The cells that have a visible corner, and all that are nearer to one than the reach.

    Args:
        grid: the baked field.
        reach: metres.
    """
    table = density_from_activation(brick_table(grid).rows[:, 3]) > VISIBLE_DENSITY
    dense = table[: -(SIDE**3)].reshape(-1, SIDE, SIDE, SIDE)
    rings = math.ceil(reach / grid.voxel)
    margin = rings + 2
    sizes = [size * CELLS + 1 + 2 * margin for size in grid.index.shape]
    nodes = torch.zeros(sizes, device=grid.low.device)
    step = torch.arange(SIDE, device=grid.low.device) + margin
    place = (grid.index >= 0).nonzero()
    order = grid.index[grid.index >= 0].long()
    z, y, x = (place[:, axis, None] * CELLS + step for axis in range(3))
    where = (z[:, :, None, None], y[:, None, :, None], x[:, None, None, :])
    nodes[where] = dense[order].float()
    for _ in range(rings):
        nodes = F.max_pool3d(nodes[None, None], 3, 1, 1)[0, 0]
    cells = F.max_pool3d(nodes[None, None], 2, 1)[0, 0] > 0
    return FilledVoxels(grid.low - margin * grid.voxel, grid.voxel, cells)


@torch.no_grad()
def anchors(filled: FilledVoxels, volume: SkinningVolume) -> Anchors:
    """Points of filled cells, `ANCHOR_SPACING` apart, that some bone holds."""
    stride = max(1, round(ANCHOR_SPACING / filled.edge))
    z, y, x = (
        F.max_pool3d(filled.cells[None, None].float(), stride, ceil_mode=True)[0, 0]
        .nonzero()
        .unbind(-1)
    )
    points = filled.low + (torch.stack([x, y, z], -1) + 0.5) * (stride * filled.edge)
    rows = volume.weights.permute(1, 2, 3, 0).contiguous()
    weights = trilinear(rows, nodes_from_canonical(points, volume))
    total = weights.sum(-1, keepdim=True)
    held = (total[:, 0] > LEAST_LIKELIHOOD).nonzero()[:, 0]
    return Anchors(points[held], weights[held] / total[held])


@torch.no_grad()
def posed_grid(
    known: Anchors,
    filled: FilledVoxels,
    body_from_canonical: Float[Tensor, "24 4 4"],
    limits: tuple[Float[Tensor, "2 3"], float],
    rows_at: Callable[[Float[Tensor, "points 3"]], Float[Tensor, "points 5"]],
) -> PosedGrid:
    """The grid around a posed body, and which of its parts reach filled canonical space.

    The forward warp of the anchors says where to look; from there it grows as long as cells at the
    border hold something: where bones touch, the backward warp shows more than the forward one.

    Args:
        known: of the filled cells.
        filled: of the baked field, with the half diagonal of a part as its reach.
        body_from_canonical: the bones' motions.
        limits: box to stay in, posed body frame, metres; and likelihood at a part's middle below
            which it is left out.
        rows_at: the rows of points, posed body frame, metres.
    """
    bounds, threshold = limits
    x, y, z = (torch.ceil((bounds[1] - bounds[0]) / CELL).long().clamp(min=1) + 3).tolist()
    low = bounds[0] - CELL  # a layer of cells around the bounds that is never asked
    table = bounds.new_zeros(x * y * z, 5)
    live = torch.zeros([(size - 1) * PARTS for size in (x, y, z)], dtype=torch.bool)
    live = live.to(bounds.device)
    places = blend(known.points, known.weights, body_from_canonical)
    inside = ((places >= bounds[0]) & (places <= bounds[1])).all(-1).nonzero()[:, 0]
    cell = ((places[inside] - low) / CELL).floor().long()
    new = torch.zeros((x - 1, y - 1, z - 1), dtype=torch.bool, device=bounds.device)
    new[cell.unbind(-1)] = True
    new = _grown(new)
    asked = torch.zeros_like(new)
    node_done = torch.zeros(x * y * z, dtype=torch.bool, device=bounds.device)
    for _ in range(GROWTH):
        asked |= new
        node = (_corners_of(new).reshape(-1) & ~node_done).nonzero()[:, 0]
        node_done[node] = True
        place = torch.stack([node // (y * z), node // z % y, node % z], -1)
        table.index_copy_(0, node, rows_at(low + place * CELL))
        parts = _live_parts(table, new.nonzero(), (x, y, z), filled, threshold)
        live[parts.unbind(-1)] = True
        reached = torch.zeros_like(new)
        reached[torch.div(parts, PARTS, rounding_mode="floor").unbind(-1)] = True
        new = _grown(reached) & ~asked
        if not bool(new.any()):
            break
    return PosedGrid(low, CELL, (x, y, z), table, live, live.nonzero())


def _live_parts(
    table: Float[Tensor, "nodes 5"],
    cells: Int[Tensor, "cells 3"],
    sizes: tuple[int, int, int],
    filled: FilledVoxels,
    threshold: float,
) -> Int[Tensor, "live 3"]:
    """The parts of cells whose middles are near something in canonical space."""
    _, y, z = sizes
    first = (cells[:, 0] * y + cells[:, 1]) * z + cells[:, 2]
    corner = torch.tensor(list(itertools.product((0, 1), repeat=3)), device=first.device)
    steps = (corner[:, 0] * y + corner[:, 1]) * z + corner[:, 2]
    part = torch.cartesian_prod(*[torch.arange(PARTS, device=first.device)] * 3)
    share = ((part.to(table) + 0.5) / PARTS)[:, None]
    weights = torch.where(corner > 0, share, 1 - share).prod(-1)
    corners = table.index_select(0, (first[:, None] + steps).reshape(-1)).reshape(-1, 8, 5)
    middle = (weights @ corners).reshape(-1, 5)
    alive = _is_filled(filled, middle) & (middle[:, 4] >= threshold)
    return (cells[:, None] * PARTS + part).reshape(-1, 3)[alive]


def _grown(cells: Bool[Tensor, "x y z"]) -> Bool[Tensor, "x y z"]:
    """True also beside what is true, but not in the outermost layer."""
    wide = cells
    for axis in range(3):  # several times faster than max_pool3d
        size = wide.shape[axis]
        beside = wide.clone()
        beside.narrow(axis, 1, size - 1).logical_or_(wide.narrow(axis, 0, size - 1))
        beside.narrow(axis, 0, size - 1).logical_or_(wide.narrow(axis, 1, size - 1))
        wide = beside
    inner = torch.zeros_like(wide)
    inner[1:-1, 1:-1, 1:-1] = wide[1:-1, 1:-1, 1:-1]
    return inner


def _corners_of(cells: Bool[Tensor, "x y z"]) -> Bool[Tensor, "nx ny nz"]:
    corners = F.pad(cells, (1, 1, 1, 1, 1, 1))
    for axis in range(3):
        size = corners.shape[axis] - 1
        corners = corners.narrow(axis, 0, size) | corners.narrow(axis, 1, size)
    return corners


def places_of(rows: Float[Tensor, "points 5"]) -> Float[Tensor, "points 3"]:
    """The places that are looked up, of rows between nodes, metres."""
    return rows[:, :3] / rows[:, 3:4].clamp(min=LEAST_SHARE)


def _is_filled(filled: FilledVoxels, rows: Float[Tensor, "rows 5"]) -> Bool[Tensor, "rows"]:
    cell = ((places_of(rows) - filled.low) / filled.edge).floor().long()
    depth, height, width = filled.cells.shape
    x, y, z = cell.T.contiguous().unbind(0)
    x, y, z = x.clamp(0, width - 1), y.clamp(0, height - 1), z.clamp(0, depth - 1)
    where = (z * height + y) * width + x
    return filled.cells.reshape(-1).index_select(0, where) & (rows[:, 3] > 0)


__all__ = [
    "LEAST_LIKELIHOOD",
    "PARTS",
    "Anchors",
    "FilledVoxels",
    "PosedGrid",
    "anchors",
    "filled_voxels",
    "places_of",
    "posed_grid",
]
