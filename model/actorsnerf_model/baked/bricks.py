"""A sparse grid of colour and density: bricks of nodes where something is, nothing elsewhere.

A brick holds the nodes of `CELLS`^3 cells with all their corners, so that a look-up asks once for
its brick and then reads eight nodes. Density is stored as the number that softplus would turn into
it, which interpolates like a network's last layer: a surface can lie between two nodes.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int, Shaped, UInt8
from torch import Tensor

CELLS = 4
"""Cells along the edge of a brick."""
SIDE = CELLS + 1
"""Nodes along the edge of a brick; neighbours repeat those they share."""
DENSITY_SCALE = 30.0
"""1/metre for one unit of activation; below it density interpolates like its logarithm."""
LEAST_DENSITY = 0.1
"""1/metre; less stops a hundredth of the light in 10 cm and is stored as nothing."""
VISIBLE_DENSITY = 0.5
"""1/metre; less stops half a hundredth of the light in a centimetre and is stepped over."""
MOST_DENSITY = 3000.0
"""1/metre; more cannot be told apart: 99.7 % of the light is stopped in 2 mm."""
_LOWEST = float(torch.tensor(LEAST_DENSITY / DENSITY_SCALE, dtype=torch.float64).expm1().log())


@dataclass(frozen=True)
class BrickGrid:
    """Colour and density in a box."""

    low: Float[Tensor, "3"]
    """Place of the first node x, y, z, metres."""
    voxel: float
    """Distance between nodes, metres."""
    index: Int[Tensor, "bz by bx"]
    """Number of each place's brick, int32; -1 where there is none."""
    codes: UInt8[Tensor, "bricks nodes 4"]
    """Red, green, blue and coded density; nodes in order z, y, x."""
    top: float
    """Activation that the density's code 255 stands for."""

    @property
    def bytes(self) -> int:
        """Of index and codes."""
        return 4 * self.index.numel() + self.codes.numel()


@dataclass(frozen=True)
class BrickTable:
    """The same ready for look-ups: a plane for each channel, and empty bricks around all."""

    grid: BrickGrid
    index: Int[Tensor, "places"]
    """First node of each place's brick, int32, of a volume one brick wider on every side."""
    codes: UInt8[Tensor, "4 nodes"]
    """Of red, green, blue and density; the last brick is empty."""


@dataclass(frozen=True)
class Cells:
    """Where points lie between the nodes of a table."""

    first: Int[Tensor, "points"]
    """The lowest corner's node, int32."""
    share: Float[Tensor, "3 points"]
    """From it to the opposite corner, x, y, z in [0, 1)."""


def activation_from_density(density: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """The number that `density_from_activation` turns into the density, 1/metre."""
    relative = density.clamp(LEAST_DENSITY, MOST_DENSITY) / DENSITY_SCALE
    return relative + torch.log(-torch.expm1(-relative))


def density_from_activation(activation: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Density, 1/metre; exactly 0 at the activation of `LEAST_DENSITY` and below."""
    density = F.softplus(activation) * DENSITY_SCALE
    return density * (activation > _LOWEST + 1e-3)


def encode(
    rgb: Float[Tensor, "bricks nodes 3"], density: Float[Tensor, "bricks nodes"]
) -> tuple[UInt8[Tensor, "bricks nodes 4"], float]:
    """Codes of nodes, and the activation that the highest code of density stands for."""
    activation = activation_from_density(density)
    top = float(activation.amax()) if activation.numel() else 0.0
    share = (activation - _LOWEST) / max(top - _LOWEST, 1e-6)
    values = torch.cat([rgb, share[..., None]], -1).clamp(0, 1)
    return (values * 255).round().to(torch.uint8), top


def density_from_code(code: Shaped[Tensor, "*shape"], top: float) -> Float[Tensor, "*shape"]:
    """Density, 1/metre, of codes in [0, 255] or of numbers between them.

    Args:
        code: of density.
        top: of the grid.
    """
    return density_from_activation(code * (max(top - _LOWEST, 1e-6) / 255) + _LOWEST)


def brick_table(grid: BrickGrid) -> BrickTable:
    """The grid ready for look-ups."""
    empty = grid.codes.new_zeros(1, SIDE**3, 4)
    codes = torch.cat([grid.codes, empty]).reshape(-1, 4).T.contiguous()
    index = F.pad(grid.index, (1, 1, 1, 1, 1, 1), value=-1)
    index = torch.where(index < 0, grid.codes.shape[0], index) * SIDE**3
    return BrickTable(grid, index.reshape(-1).int(), codes)


def look_up(
    table: BrickTable, points: Float[Tensor, "points 3"]
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points"]]:
    """Colour in [0, 1] and density, 1/metre, between the nodes; nothing outside.

    Args:
        table: of `brick_table`.
        points: metres.
    """
    cells = cells_at(table, points.T.contiguous())
    return colour_at(table, cells).T.contiguous(), density_at(table, cells)


def cells_at(table: BrickTable, points: Float[Tensor, "3 points"]) -> Cells:
    """Where points (metres) lie; those outside in an empty brick."""
    grid = table.grid
    bricks = grid.index.shape[::-1]
    share, where, within = [], None, None
    for axis in (2, 1, 0):
        # In cells of the volume with its border of one brick; whole numbers below 2^24 are exact.
        place = (points[axis] - grid.low[axis]) / grid.voxel + CELLS
        place = place.clamp(0, (bricks[axis] + 2) * CELLS - 1)
        cell = place.floor()
        share.append(place - cell)
        brick = (cell / CELLS).floor()
        local = cell - brick * CELLS
        where = brick if where is None else where * (bricks[axis] + 2) + brick
        within = local if within is None else within * SIDE + local
    assert where is not None and within is not None
    first = table.index.index_select(0, where.int()) + within.int()
    return Cells(first, torch.stack(share[::-1]))


def density_at(table: BrickTable, cells: Cells) -> Float[Tensor, "points"]:
    """Density between the nodes, 1/metre."""
    code = read_corners(table.codes[3:], cells.first, cells.share, (SIDE * SIDE, SIDE, 1))[0]
    return density_from_code(code, table.grid.top)


def colour_at(table: BrickTable, cells: Cells) -> Float[Tensor, "3 points"]:
    """Colour between the nodes, in [0, 1]."""
    return read_corners(table.codes[:3], cells.first, cells.share, (SIDE * SIDE, SIDE, 1)) / 255


def read_corners(
    planes: Shaped[Tensor, "channels nodes"],
    first: Int[Tensor, "points"],
    share: Float[Tensor, "3 points"],
    strides: tuple[int, int, int],
) -> Float[Tensor, "channels points"]:
    """Values between the eight corners of cells.

    Channel by channel: a CPU reads single numbers and interpolates long vectors several times
    faster than it sums short rows.

    Args:
        planes: a number for each channel and node, of any type.
        first: each cell's lowest corner.
        share: how far each point is from it to the opposite corner, x, y, z in [0, 1].
        strides: how many nodes on the next one along z, y, x is.
    """
    x, y, z = share.unbind(0)
    dz, dy, dx = strides
    corner = [
        (first, first + dx, first + dy, first + (dy + dx)),
        (first + dz, first + (dz + dx), first + (dz + dy), first + (dz + dy + dx)),
    ]
    read = share.new_empty(planes.shape[0], first.shape[0])
    for number, plane in enumerate(planes):
        sides = []
        for side in corner:
            a, b, c, d = (plane.index_select(0, node).to(share.dtype) for node in side)
            near, far = torch.lerp(a, b, x), torch.lerp(c, d, x)
            sides.append(torch.lerp(near, far, y))
        torch.lerp(sides[0], sides[1], z, out=read[number])
    return read


__all__ = [
    "CELLS",
    "LEAST_DENSITY",
    "SIDE",
    "VISIBLE_DENSITY",
    "BrickGrid",
    "BrickTable",
    "Cells",
    "activation_from_density",
    "brick_table",
    "cells_at",
    "colour_at",
    "density_at",
    "density_from_activation",
    "density_from_code",
    "encode",
    "look_up",
    "read_corners",
]
