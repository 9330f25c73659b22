"""Linear interpolation between grid nodes as one weighted sum of table rows.

Coordinates are in nodes: node (0, 0) is at (0.0, 0.0), and outside the grid the table is zero.
These are `grid_sample`'s values for align_corners=True and zero padding, several times faster on a
CPU, because a point's corners are read as whole rows by `embedding_bag`.
"""

from collections.abc import Callable
from typing import TypeAlias

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

Layer: TypeAlias = Callable[[Float[Tensor, "rows channels"]], Float[Tensor, "rows read"]]
"""What every row goes through by itself."""
ROWS_AT_ONCE = 32768
"""Points per pass where no gradient is wanted; keeps the corner arithmetic in the cache."""


def bilinear(
    tables: Float[Tensor, "tables height width channels"],
    xy: Float[Tensor, "tables points 2"],
    layer: Layer | None = None,
) -> Float[Tensor, "tables points read"]:
    """Rows of each table read between four nodes; zero outside. Differentiable in both arguments.

    Args:
        tables: one row of channels per node.
        xy: x, y in nodes of each table's own points.
        layer: linear, without bias; computed for the rows that are read, and for no others.

    >>> bilinear(torch.tensor([[[[0.0], [2.0]]]]), torch.tensor([[[0.5, 0.0]]])).tolist()
    [[[1.0]]]
    """
    count, height, width, channels = tables.shape
    first = height * width * torch.arange(count, device=xy.device)
    first = first[:, None].expand(-1, xy.shape[1]).reshape(-1)
    rows, places = tables.reshape(-1, channels), xy.reshape(-1, 2)
    read = _interpolate(rows, places, (height, width), first, layer)
    return read.reshape(count, xy.shape[1], read.shape[-1])


def trilinear(
    volume: Float[Tensor, "depth height width channels"], xyz: Float[Tensor, "points 3"]
) -> Float[Tensor, "points channels"]:
    """Volume rows read between eight nodes; zero outside. Differentiable in both arguments.

    Args:
        volume: one row of channels per node; axes z, y, x.
        xyz: x, y, z in nodes.
    """
    rows = volume.reshape(-1, volume.shape[-1])
    return _interpolate(rows, xyz, tuple(volume.shape[:-1]))


def corners(
    coordinates: Float[Tensor, "points axes"], sizes: tuple[int, ...]
) -> tuple[Int[Tensor, "points corners"], Float[Tensor, "points corners"]]:
    """Flat node numbers and weights of each point's 2^axes corners.

    A corner outside the grid has weight 0 and some node's number.

    Args:
        coordinates: in nodes, x first.
        sizes: nodes per axis in memory order, x last.
    """
    strides = [1]
    for size in reversed(sizes[1:]):
        strides.append(strides[-1] * size)
    # One tensor per corner until the end: long rows are far faster than pairs side by side.
    indices = [torch.zeros(1, dtype=torch.long, device=coordinates.device)]
    weights = [coordinates.new_ones(1)]
    for axis, (size, stride) in enumerate(zip(reversed(sizes), strides, strict=True)):
        # Beyond one node outside everything is zero; clamping keeps the integers in range.
        place = coordinates[:, axis].clamp(-1.5, size + 0.5)
        low = place.detach().floor()
        share = place - low
        nodes, sides = [], []
        for node, side in ((low, 1 - share), (low + 1, share)):
            held = node.long().clamp(0, size - 1)  # whole numbers first: what is none becomes one
            nodes.append(held * stride)
            sides.append(side * (node == held))
        indices = [node + index for node in nodes for index in indices]
        weights = [side * weight for side in sides for weight in weights]
    return torch.stack(indices, -1), torch.stack(weights, -1)


def _interpolate(
    rows: Float[Tensor, "nodes channels"],
    coordinates: Float[Tensor, "points axes"],
    sizes: tuple[int, ...],
    first: Int[Tensor, "points"] | None = None,
    layer: Layer | None = None,
) -> Float[Tensor, "points read"]:
    """Rows between a grid's nodes; `first` is the number of each point's node (0, 0)."""
    wants_gradient = torch.is_grad_enabled() and (rows.requires_grad or coordinates.requires_grad)
    if wants_gradient or coordinates.shape[0] <= ROWS_AT_ONCE:
        # In one piece: each call's backward makes a gradient as large as the table.
        return _weighted_rows(rows, coordinates, sizes, first, layer)
    pieces = []
    for begin in range(0, coordinates.shape[0], ROWS_AT_ONCE):
        part = slice(begin, begin + ROWS_AT_ONCE)
        own = None if first is None else first[part]
        pieces.append(_weighted_rows(rows, coordinates[part], sizes, own, layer))
    return torch.cat(pieces)


def _weighted_rows(
    rows: Float[Tensor, "nodes channels"],
    coordinates: Float[Tensor, "points axes"],
    sizes: tuple[int, ...],
    first: Int[Tensor, "points"] | None,
    layer: Layer | None,
) -> Float[Tensor, "points read"]:
    if coordinates.shape[0] == 0:
        none = rows[:0] if layer is None else layer(rows[:0])
        return none + coordinates.sum() * 0
    index, weight = corners(coordinates, sizes)
    if first is not None:
        index = index + first[:, None]
    if layer is not None:
        index, rows = _only_read(rows, index)
        rows = layer(rows)
    return F.embedding_bag(index, rows, mode="sum", per_sample_weights=weight.to(rows.dtype))


def _only_read(
    rows: Float[Tensor, "nodes channels"], index: Int[Tensor, "points corners"]
) -> tuple[Int[Tensor, "points corners"], Float[Tensor, "read channels"]]:
    """The rows that an index names, each once, and the index among them."""
    read = torch.zeros(rows.shape[0], dtype=torch.bool, device=rows.device)
    read.index_fill_(0, index.reshape(-1), True)
    number = read.cumsum(0) - 1
    return number[index], rows.index_select(0, read.nonzero()[:, 0])


__all__ = ["Layer", "bilinear", "corners", "trilinear"]
