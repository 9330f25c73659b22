"""A baked actor's backward warp around the posed body: computed once per pose.

The warp is smooth where some bone holds the place, so it is computed at the nodes of a coarse grid
and mapped linearly in each part of a cell. A node that no bone holds has no say.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from actorsnerf_model.baked.filled_voxels import Anchors, FilledVoxels, grown
from actorsnerf_model.baked.node_warp import LEAST_LIKELIHOOD
from actorsnerf_model.baked.part_maps import PARTS, PartMaps, live_parts

CELL = 0.04
"""Metres between the nodes at which the warp is computed."""


@dataclass(frozen=True)
class PosedGrid:
    """Where points around a posed body lie in canonical space."""

    low: Float[Tensor, "3"]
    """Corner of the first part, posed body frame, metres."""
    edge: float
    """Of the parts, metres."""
    number: Int[Tensor, "px py pz"]
    """Of each part's map, int32; -1 where nothing can be seen, and in the outermost layer."""
    parts: Int[Tensor, "3 live"]
    """Where something can be."""
    maps: Float[Tensor, "16 cells"]
    """Of `PartMaps`."""
    rough: Bool[Tensor, "cells"]
    """Where the warp itself must be asked."""


@torch.no_grad()
def posed_grid(
    known: Anchors,
    filled: FilledVoxels,
    body_from_canonical: Float[Tensor, "24 4 4"],
    limits: tuple[Float[Tensor, "2 3"], float],
    warp: Callable[[Float[Tensor, "3 points"]], Float[Tensor, "4 points"]],
) -> PosedGrid:
    """The grid around a posed body.

    The bones' motions of the anchors say where to look; from there it grows as long as cells at the
    border hold something, so that whatever is connected to a place under an anchor is there.

    Args:
        known: of the filled cells.
        filled: of the baked field.
        body_from_canonical: the bones' motions.
        limits: box to stay in, posed body frame, metres; and likelihood below which there is
            nothing.
        warp: places in canonical space (metres) and likelihoods of points, posed body frame,
            metres.
    """
    bounds, threshold = limits
    x, y, z = (torch.ceil((bounds[1] - bounds[0]) / CELL).long().clamp(min=1) + 3).tolist()
    low = bounds[0] - CELL  # a layer of cells around the bounds that is never asked
    rows = bounds.new_zeros(5, x * y * z)
    new = _inner(grown(_seeded(known, body_from_canonical, low, (x - 1, y - 1, z - 1))))
    asked = torch.zeros_like(new)
    done = torch.zeros(x * y * z, dtype=torch.bool, device=bounds.device)
    found = []
    while True:
        asked |= new
        node = (_corners_of(new).reshape(-1) & ~done).nonzero()[:, 0]
        done[node] = True
        place = torch.stack([node // (y * z), node // z % y, node % z])
        there = warp(place * CELL + low[:, None])
        held = (there[3] > LEAST_LIKELIHOOD).to(there)
        rows[:, node] = torch.cat([there[:3] * held, held[None], there[3:]])
        cells = new.nonzero().T.contiguous()
        found.append(live_parts(rows, cells, (x, y, z), filled, threshold))
        reached = torch.zeros_like(new)
        reached[torch.div(found[-1].parts, PARTS, rounding_mode="floor").unbind(0)] = True
        new = _inner(grown(reached)) & ~asked
        if not bool(new.any()):
            break
    return _joined(found, low, (x - 1, y - 1, z - 1))


def _joined(
    found: list[PartMaps], low: Float[Tensor, "3"], cells: tuple[int, int, int]
) -> PosedGrid:
    shape = [size * PARTS for size in cells]
    number = torch.full(shape, -1, dtype=torch.int32, device=low.device)
    count = 0
    for some in found:
        number[some.parts.unbind(0)] = (some.number + count).int()
        count += some.maps.shape[1]
    return PosedGrid(
        low,
        CELL / PARTS,
        number,
        torch.cat([some.parts for some in found], 1),
        torch.cat([some.maps for some in found], 1),
        torch.cat([some.rough for some in found]),
    )


def _seeded(
    known: Anchors,
    body_from_canonical: Float[Tensor, "24 4 4"],
    low: Float[Tensor, "3"],
    sizes: tuple[int, int, int],
) -> Bool[Tensor, "x y z"]:
    """The cells to which a bone on its own carries one of its anchors."""
    motions = body_from_canonical[:, :3]
    shift = motions[..., 3:] - low[:, None]
    places = torch.cat(
        [
            torch.addmm(moved, motion[:, :3], points)
            for motion, moved, points in zip(motions, shift, known.points, strict=True)
        ],
        1,
    )
    x, y, z = (places / CELL).floor().unbind(0)
    inside = (x >= 0) & (x < sizes[0]) & (y >= 0) & (y < sizes[1]) & (z >= 0) & (z < sizes[2])
    cell = ((x * sizes[1] + y) * sizes[2] + z)[inside].long()
    cells = torch.zeros(sizes, dtype=torch.bool, device=low.device)
    cells.reshape(-1).index_fill_(0, cell, True)
    return cells


def _inner(cells: Bool[Tensor, "x y z"]) -> Bool[Tensor, "x y z"]:
    """The same without the outermost layer."""
    return F.pad(cells[1:-1, 1:-1, 1:-1], (1, 1, 1, 1, 1, 1))


def _corners_of(cells: Bool[Tensor, "x y z"]) -> Bool[Tensor, "nx ny nz"]:
    corners = F.pad(cells, (1, 1, 1, 1, 1, 1))
    for axis in range(3):
        size = corners.shape[axis] - 1
        corners = corners.narrow(axis, 0, size) | corners.narrow(axis, 1, size)
    return corners


__all__ = ["CELL", "PosedGrid", "posed_grid"]
