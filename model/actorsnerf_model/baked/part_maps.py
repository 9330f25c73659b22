"""A warp between the nodes of cells as one linear map for each part of a cell.

Where a part lies in canonical space then is a parallelepiped, and whether it can reach anything is
decided for all its points at once.
"""

import itertools
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from actorsnerf_model.baked.filled_voxels import FilledVoxels

PARTS = 2
"""Parts of a cell along each axis; each has a map of its own and is stepped over if empty."""
LEAST_SHARE = 1e-3
"""Under the division by the weights of a cell's nodes."""
MAP = 16
"""Numbers of a map."""
ROUGH = 0.008
"""Metres between a node's place and its cell's map from which the warp counts as no linear map:
about a voxel. It happens where bones meet that point apart."""


@dataclass(frozen=True)
class PartMaps:
    """Parts of cells that can show something, and their maps."""

    parts: Int[Tensor, "3 live"]
    """x, y, z, counted in parts."""
    number: Int[Tensor, "live"]
    """Of each part's map: that of its cell."""
    rough: Bool[Tensor, "cells"]
    """Where a map misses one of its cell's nodes by `ROUGH`, or a node that no bone holds."""
    maps: Float[Tensor, "16 cells"]
    """Four rows each of what is mapped to (place x, y, z in metres; likelihood): at part 0, and
    what a part along x, y, z adds."""


@torch.no_grad()
def live_parts(
    rows: Float[Tensor, "5 nodes"],
    cells: Int[Tensor, "3 cells"],
    sizes: tuple[int, int, int],
    filled: FilledVoxels,
    threshold: float,
) -> PartMaps:
    """The parts of cells with a point that is mapped to something visible and likely enough.

    Where all nodes of a cell are held and the cell is not rough, no part is missed: between the
    nodes the warp differs from the map by at most what the map misses at one of them, so a part's
    image lies in the box around its parallel edges widened by that, and a box that reaches no
    visible cell holds nothing denser than `VISIBLE_DENSITY`. Of rough cells, whose points are asked
    exactly, all parts are kept.

    Args:
        rows: of nodes: place times weight, weight, likelihood; the last axis z is the fastest.
        cells: x, y, z.
        sizes: nodes along x, y, z.
        filled: of the field.
        threshold: likelihood below which there is nothing.
    """
    _, y, z = sizes
    first = (cells[0] * y + cells[1]) * z + cells[2]
    corner = torch.tensor(list(itertools.product((0, 1), repeat=3)), device=rows.device)
    steps = ((corner[:, 0] * y + corner[:, 1]) * z + corner[:, 2]).tolist()
    values = torch.stack([rows.index_select(1, first + step) for step in steps])
    read = (_weights(rows) @ values.reshape(8, -1)).reshape(4, 5, -1)
    share = read[0, 3].clamp(min=LEAST_SHARE)
    maps = torch.empty(4, 4, first.shape[0], dtype=rows.dtype, device=rows.device)
    maps[0, :3] = read[0, :3] / share
    maps[1:, :3] = (read[1:, :3] - maps[0, :3] * read[1:, 3:4]) / share
    maps[:, 3] = read[:, 4]
    missed = _missed(values[:, [0, 1, 2, 4]], maps)
    half = maps[1:].abs().sum(0) / 2
    near = _reaches(maps[:1], half * PARTS + missed, filled, threshold)[0]
    kept = (near & (read[0, 3] > 0)).nonzero()[:, 0]
    maps, own = maps.index_select(2, kept), cells.index_select(1, kept) * PARTS
    rough = (missed[:3].amax(0) >= ROUGH) | (read[0, 3] < 1 - LEAST_SHARE)
    part = torch.tensor(list(itertools.product(range(PARTS), repeat=3)), device=rows.device)
    away = (part + (0.5 - PARTS / 2)).to(maps)
    middles = (away @ maps[1:].reshape(3, -1)).reshape(part.shape[0], 4, kept.shape[0]) + maps[0]
    alive = _reaches(middles, (half + missed).index_select(1, kept), filled, threshold)
    alive |= rough.index_select(0, kept)
    which, column = alive.nonzero().unbind(-1)
    parts = own.index_select(1, column) + part.T.contiguous().index_select(1, which)
    middle = own + PARTS / 2
    for axis in range(3):
        maps[0].addcmul_(maps[axis + 1], middle[axis], value=-1)
    return PartMaps(parts, column, rough.index_select(0, kept), maps.reshape(MAP, -1))


def _missed(
    nodes: Float[Tensor, "8 4 cells"], maps: Float[Tensor, "4 4 cells"]
) -> Float[Tensor, "4 cells"]:
    """By how much each cell's map misses any of its nodes.

    Between the nodes it misses what is interpolated by no more.
    """
    corner = torch.tensor(list(itertools.product((-1.0, 1.0), repeat=3))).to(maps)
    corner = torch.cat([torch.ones_like(corner[:, :1]), corner * (PARTS / 2)], 1)
    return ((corner @ maps.reshape(4, -1)).reshape(nodes.shape) - nodes).abs().amax(0)


def _weights(like: Tensor) -> Float[Tensor, "4 8"]:
    """What corners count at a cell's middle, and for what a part along x, y, z adds there."""
    corner = torch.tensor(list(itertools.product((-1.0, 1.0), repeat=3))).to(like)
    return torch.cat([torch.full_like(corner[:, :1], 1 / 8), corner / 4 / PARTS], 1).T.contiguous()


def _reaches(
    middles: Float[Tensor, "parts 4 cells"],
    extent: Float[Tensor, "4 cells"],
    filled: FilledVoxels,
    threshold: float,
) -> Tensor:
    """Whether any point of a box can be seen."""
    shape = filled.rings.shape[::-1]
    flat, radius = None, None
    for axis in (2, 1, 0):
        place = (middles[:, axis] - filled.low[axis]) / filled.edge
        reach = extent[axis] / filled.edge
        cell = place.floor()
        steps = ((place + reach).floor_() - cell).maximum(cell - (place - reach).floor_())
        radius = steps if radius is None else radius.maximum(steps)
        cell = cell.clamp_(0, shape[axis] - 1)
        flat = cell if flat is None else flat * shape[axis] + cell
    assert flat is not None and radius is not None
    rings = filled.rings.reshape(-1).index_select(0, flat.reshape(-1).int()).reshape(flat.shape)
    return (rings <= radius) & (middles[:, 3] + extent[3] >= threshold)


__all__ = ["MAP", "PARTS", "PartMaps", "live_parts"]
