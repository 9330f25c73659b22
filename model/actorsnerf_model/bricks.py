"""A sparse grid of colour and density: bricks of nodes where something is, nothing elsewhere.

A brick holds the nodes of `CELLS`^3 cells with all their corners, so that a look-up asks once for
its brick and then reads eight rows. Density is stored as the number that softplus would turn into
it, which interpolates like a network's last layer: a surface can lie between two nodes.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int, UInt8
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
    """The same ready for look-ups: decoded rows, and a border of empty bricks around all."""

    grid: BrickGrid
    index: Int[Tensor, "places"]
    """First row of each place's brick, int64, of a volume one brick wider on every side."""
    rows: Float[Tensor, "rows 4"]
    """Red, green, blue in [0, 1] and activation; the last brick is empty."""


def activation_from_density(density: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """The number that `density_from_activation` turns into the density, 1/metre."""
    relative = density.clamp(LEAST_DENSITY, MOST_DENSITY) / DENSITY_SCALE
    return relative + torch.log(-torch.expm1(-relative))


def density_from_activation(activation: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Density, 1/metre; exactly 0 at the activation of `LEAST_DENSITY` and below."""
    density = F.softplus(activation) * DENSITY_SCALE
    return torch.where(activation > _LOWEST + 1e-3, density, 0.0)


def encode(
    rgb: Float[Tensor, "bricks nodes 3"], density: Float[Tensor, "bricks nodes"]
) -> tuple[UInt8[Tensor, "bricks nodes 4"], float]:
    """Codes of nodes, and the activation that the highest code of density stands for."""
    activation = activation_from_density(density)
    top = float(activation.amax()) if activation.numel() else 0.0
    share = (activation - _LOWEST) / max(top - _LOWEST, 1e-6)
    values = torch.cat([rgb, share[..., None]], -1).clamp(0, 1)
    return (values * 255).round().to(torch.uint8), top


def brick_table(grid: BrickGrid) -> BrickTable:
    """The grid decoded."""
    values = grid.codes.to(grid.low.dtype) / 255
    values[..., 3] = _LOWEST + values[..., 3] * max(grid.top - _LOWEST, 1e-6)
    empty = values.new_tensor([0.0, 0.0, 0.0, _LOWEST]).expand(1, SIDE**3, 4)
    rows = torch.cat([values, empty]).reshape(-1, 4)
    index = F.pad(grid.index, (1, 1, 1, 1, 1, 1), value=-1).long()
    index = torch.where(index < 0, grid.codes.shape[0], index) * SIDE**3
    return BrickTable(grid, index.reshape(-1), rows)


def look_up(
    table: BrickTable, points: Float[Tensor, "points 3"]
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points"]]:
    """Colour in [0, 1] and density, 1/metre, between the nodes; nothing outside.

    Args:
        table: of `brick_table`.
        points: metres.
    """
    grid = table.grid
    shape = torch.tensor(grid.index.shape[::-1], device=points.device)
    # From here on in cells of the volume with its border of one brick.
    place = (points - grid.low) / grid.voxel + CELLS
    last = ((shape + 2) * CELLS - 1).to(place)
    place = place.clamp(torch.zeros_like(last), last)
    cell = place.floor()
    share = (place - cell).T.contiguous()
    brick = (cell / CELLS).floor()
    local = cell - brick * CELLS
    # Whole numbers below 2^24: exact in float32.
    where = (brick[:, 2] * (shape[1] + 2) + brick[:, 1]) * (shape[0] + 2) + brick[:, 0]
    within = (local[:, 2] * SIDE + local[:, 1]) * SIDE + local[:, 0]
    first = table.index.index_select(0, where.long()) + within.long()
    rows = read_corners(table.rows, first, share, (SIDE * SIDE, SIDE, 1))
    return rows[:, :3], density_from_activation(rows[:, 3])


def read_corners(
    rows: Float[Tensor, "rows channels"],
    first: Int[Tensor, "points"],
    share: Float[Tensor, "3 points"],
    strides: tuple[int, int, int],
) -> Float[Tensor, "points channels"]:
    """Rows between the eight corners of cells.

    Args:
        rows: one per node.
        first: each cell's lowest corner.
        share: how far each point is from it to the opposite corner, x, y, z in [0, 1].
        strides: how many rows on the next node along z, y, x is.
    """
    if first.shape[0] == 0:
        return rows[:0]
    x, y, z = share.unbind(0)
    a, b = 1 - x, x
    ac, bc = a * (1 - y), b * (1 - y)
    ad, bd = a - ac, b - bc
    upper = [ac * z, bc * z, ad * z, bd * z]
    weights = [ac - upper[0], bc - upper[1], ad - upper[2], bd - upper[3], *upper]
    dz, dy, dx = strides
    step = first.new_tensor([0, dx, dy, dy + dx, dz, dz + dx, dz + dy, dz + dy + dx])
    return F.embedding_bag(
        first[:, None] + step, rows, mode="sum", per_sample_weights=torch.stack(weights, -1)
    )


__all__ = [
    "CELLS",
    "LEAST_DENSITY",
    "SIDE",
    "VISIBLE_DENSITY",
    "BrickGrid",
    "BrickTable",
    "activation_from_density",
    "brick_table",
    "density_from_activation",
    "encode",
    "look_up",
    "read_corners",
]
