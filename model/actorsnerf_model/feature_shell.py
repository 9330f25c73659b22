"""Where around a posed body sparse features reach: elsewhere every one of them is zero.

Each level of a sparse convolution halves the resolution and keeps every voxel that its kernel
reaches, so the support of a coarser level's trilinear features holds that of a finer one's. The
cells between voxels of the coarsest level, at least one corner of which is active, are the shell.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_model.occupancy import CELL
from actorsnerf_model.sparse_conv import FeatureLevel
from actorsnerf_model.states import Occupancy

SLACK = 1e-4
"""Metres around an occupancy cell, against the rounding of samples along rays."""
BORDER = 2
"""Cells beyond the first voxel: one that it reaches, and an empty one."""


@dataclass(frozen=True)
class FeatureShell:
    """The cells that features reach."""

    cells: Bool[Tensor, "z y x"]
    """Cell `BORDER` begins at the origin; the outermost are False."""
    origin: Float[Tensor, "3"]
    """x, y, z of the centre of voxel 0, metres."""
    cell: float
    """Edge of a cell, metres."""


def feature_shell(levels: Sequence[FeatureLevel]) -> FeatureShell:
    """The shell of the levels that points read."""
    coarsest = max(levels, key=lambda level: level.cell)
    active = F.pad((coarsest.index >= 0).float(), (1, 1, 1, 1, 1, 1))
    cells = F.max_pool3d(active[None, None], 2, stride=1, padding=1)[0, 0] > 0
    return FeatureShell(cells, coarsest.origin, coarsest.cell)


def in_shell(shell: FeatureShell, points: Float[Tensor, "points 3"]) -> Bool[Tensor, "points"]:
    """Whether features can differ from zero at each point (metres, frame of the voxels)."""
    axes = zip(points.unbind(-1), shell.origin, reversed(shell.cells.shape), strict=True)
    x, y, z = (_cells(values, low, shell, size) for values, low, size in axes)
    return shell.cells[z, y, x]


@torch.no_grad()
def shell_occupancy(
    shell: FeatureShell, bounds: Float[Tensor, "2 3"], threshold: float
) -> Occupancy:
    """The cells of a box that touch the shell; never one too few.

    Args:
        shell: of a pose.
        bounds: box to cover, metres.
        threshold: what the cells are said to be made for; likelihood is 1 in the shell, so it
            changes nothing.
    """
    edge = min(CELL, shell.cell / 2)
    sizes = torch.ceil((bounds[1] - bounds[0]) / edge).long().clamp(min=1)
    occupied = shell.cells.permute(2, 1, 0)
    for axis, count in enumerate(sizes.tolist()):
        low = bounds[0, axis] + edge * torch.arange(count, device=bounds.device)
        size, origin = shell.cells.shape[2 - axis], shell.origin[axis]
        # A cell this small meets at most two of the shell's along an axis.
        begin = _cells(low - SLACK, origin, shell, size)
        end = _cells(low + (edge + SLACK), origin, shell, size)
        occupied = occupied.index_select(axis, begin) | occupied.index_select(axis, end)
    box = torch.stack([bounds[0], bounds[0] + sizes * edge])
    return Occupancy(box, occupied, threshold)


def _cells(
    values: Float[Tensor, "places"], origin: Float[Tensor, ""], shell: FeatureShell, size: int
) -> Tensor:
    """The cells' numbers along an axis; the empty outermost ones for places outside."""
    place = torch.floor((values - origin) / shell.cell) + BORDER
    return place.clamp(0, size - 1).long()


__all__ = ["FeatureShell", "feature_shell", "in_shell", "shell_occupancy"]
