"""Where a baked field shows anything, how far everything else is from it, and what carries it."""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from actorsnerf_model.baked.bricks import CELLS, SIDE, VISIBLE_DENSITY, BrickGrid, density_from_code
from actorsnerf_model.interpolation import trilinear
from actorsnerf_model.skinning import SkinningVolume, nodes_from_canonical


@dataclass(frozen=True)
class FilledVoxels:
    """Cells between the nodes of a field, and how far they are from one that shows anything."""

    low: Float[Tensor, "3"]
    """Corner of the first cell, metres."""
    edge: float
    """Of the cells, metres."""
    rings: UInt8[Tensor, "z y x"]
    """Steps along axes and diagonals to the nearest cell with a visible corner; between corners
    nothing is denser than at the densest. As many as were asked for and one more: or farther."""


@dataclass(frozen=True)
class Anchors:
    """Places of the filled canonical space under each bone that may hold them on its own."""

    points: tuple[Float[Tensor, "3 _"], ...]
    """For each of the 24 bones, metres."""


@torch.no_grad()
def filled_voxels(grid: BrickGrid, reach: float) -> FilledVoxels:
    """The cells of a baked field.

    Args:
        grid: the field.
        reach: metres to which distances are told apart.
    """
    visible = density_from_code(grid.codes[..., 3].float(), grid.top) > VISIBLE_DENSITY
    dense = visible.reshape(-1, SIDE, SIDE, SIDE)
    rings = math.ceil(reach / grid.voxel)
    margin = rings + 2
    sizes = [size * CELLS + 1 + 2 * margin for size in grid.index.shape]
    nodes = torch.zeros(sizes, dtype=torch.bool, device=grid.low.device)
    step = torch.arange(SIDE, device=grid.low.device) + margin
    place = (grid.index >= 0).nonzero()
    order = grid.index[grid.index >= 0].long()
    z, y, x = (place[:, axis, None] * CELLS + step for axis in range(3))
    nodes[z[:, :, None, None], y[:, None, :, None], x[:, None, None, :]] = dense[order]
    near = nodes
    for axis in range(3):
        size = near.shape[axis] - 1
        near = near.narrow(axis, 0, size) | near.narrow(axis, 1, size)
    distance = torch.full(near.shape, rings + 1, dtype=torch.uint8, device=near.device)
    for ring in range(rings + 1):
        distance[near & (distance > ring)] = ring
        near = grown(near)
    return FilledVoxels(grid.low - margin * grid.voxel, grid.voxel, distance)


@torch.no_grad()
def anchors(filled: FilledVoxels, volume: SkinningVolume, spacing: float, least: float) -> Anchors:
    """Points near filled cells.

    Args:
        filled: of a baked field.
        volume: its skinning.
        spacing: of the points, metres, at most.
        least: weight from which a bone gets a point.
    """
    stride = max(1, math.floor(spacing / filled.edge))
    visible = (filled.rings == 0).float()[None, None]
    cells = F.max_pool3d(visible, stride, ceil_mode=True)[0, 0]
    points = (cells.nonzero().flip(-1) + 0.5) * (stride * filled.edge) + filled.low
    weights = trilinear(volume.rows, nodes_from_canonical(points, volume))
    return Anchors(tuple(points[held].T.contiguous() for held in (weights >= least).unbind(-1)))


def grown(cells: Bool[Tensor, "a b c"]) -> Bool[Tensor, "a b c"]:
    """True also beside what is true."""
    wide = cells
    for axis in range(3):  # several times faster than max_pool3d
        size = wide.shape[axis] - 1
        beside = wide.clone()
        beside.narrow(axis, 1, size).logical_or_(wide.narrow(axis, 0, size))
        beside.narrow(axis, 0, size).logical_or_(wide.narrow(axis, 1, size))
        wide = beside
    return wide


__all__ = ["Anchors", "FilledVoxels", "anchors", "filled_voxels", "grown"]
