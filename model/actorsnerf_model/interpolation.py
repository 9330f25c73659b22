"""Linear interpolation between grid nodes as one weighted sum of table rows.

Coordinates are in nodes: node (0, 0) is at (0.0, 0.0), and outside the grid the table is zero.
These are `grid_sample`'s values for align_corners=True and zero padding, several times faster on a
CPU, because a point's corners are read as whole rows by `embedding_bag`.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

ROWS_AT_ONCE = 16384
"""Points per pass where no gradient is wanted; keeps the corner arithmetic in the cache."""


def bilinear(
    table: Float[Tensor, "height width channels"], xy: Float[Tensor, "points 2"]
) -> Float[Tensor, "points channels"]:
    """Table rows read between four nodes; zero outside. Differentiable in both arguments.

    Args:
        table: one row of channels per node.
        xy: x, y in nodes.

    >>> bilinear(torch.tensor([[[0.0], [2.0]]]), torch.tensor([[0.5, 0.0]])).tolist()
    [[1.0]]
    """
    return _interpolate(table, xy)


def trilinear(
    volume: Float[Tensor, "depth height width channels"], xyz: Float[Tensor, "points 3"]
) -> Float[Tensor, "points channels"]:
    """Volume rows read between eight nodes; zero outside. Differentiable in both arguments.

    Args:
        volume: one row of channels per node; axes z, y, x.
        xyz: x, y, z in nodes.
    """
    return _interpolate(volume, xyz)


def corners(
    coordinates: Float[Tensor, "points axes"], sizes: tuple[int, ...]
) -> tuple[Int[Tensor, "points corners"], Float[Tensor, "points corners"]]:
    """Flat node numbers and weights of each point's 2^axes corners.

    A corner outside the grid has weight 0 and node 0.

    Args:
        coordinates: in nodes, x first.
        sizes: nodes per axis in memory order, x last.
    """
    strides = [1]
    for size in reversed(sizes[1:]):
        strides.append(strides[-1] * size)
    index = torch.zeros((coordinates.shape[0], 1), dtype=torch.long, device=coordinates.device)
    weight = coordinates.new_ones((coordinates.shape[0], 1))
    for axis, (size, stride) in enumerate(zip(reversed(sizes), strides, strict=True)):
        # Beyond one node outside everything is zero; clamping keeps the integers in range.
        place = coordinates[:, axis].clamp(-1.5, size + 0.5)
        low = place.detach().floor()
        share = place - low
        node = torch.stack([low, low + 1], -1).long()
        inside = (node >= 0) & (node < size)
        side = torch.stack([1 - share, share], -1) * inside
        node = (node * inside) * stride
        index = (node[:, :, None] + index[:, None, :]).flatten(1)
        weight = (side[:, :, None] * weight[:, None, :]).flatten(1)
    return index, weight


def _interpolate(
    table: Float[Tensor, "*grid channels"], coordinates: Float[Tensor, "points axes"]
) -> Float[Tensor, "points channels"]:
    sizes = tuple(table.shape[:-1])
    rows = table.reshape(-1, table.shape[-1])
    wants_gradient = torch.is_grad_enabled() and (table.requires_grad or coordinates.requires_grad)
    if wants_gradient or coordinates.shape[0] <= ROWS_AT_ONCE:
        # In one piece: each call's backward makes a gradient as large as the table.
        return _weighted_rows(rows, coordinates, sizes)
    pieces = torch.split(coordinates, ROWS_AT_ONCE)
    pieces = tuple(_weighted_rows(rows, piece, sizes) for piece in pieces)
    return torch.cat(pieces)


def _weighted_rows(
    rows: Float[Tensor, "nodes channels"],
    coordinates: Float[Tensor, "points axes"],
    sizes: tuple[int, ...],
) -> Float[Tensor, "points channels"]:
    if coordinates.shape[0] == 0:
        return rows[:0] + coordinates.sum() * 0
    index, weight = corners(coordinates, sizes)
    return F.embedding_bag(index, rows, mode="sum", per_sample_weights=weight.to(rows.dtype))


__all__ = ["bilinear", "corners", "trilinear"]
