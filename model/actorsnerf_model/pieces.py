"""How many points are computed together: on a CPU what its cache holds, elsewhere much more."""

from collections.abc import Iterator

import torch
from torch import Tensor

TILE = 1024
"""Rows through wide layers at once, on a CPU: a megabyte of 256 numbers each, so that one layer's
output is still in a core's own cache when the next one reads it."""
TIMES_OFF_CPU = 16
"""An accelerator has no such cache, and every piece costs it some starts of work."""


def at_once(on_cpu: int, device: torch.device) -> int:
    """How many points a piece has.

    >>> at_once(8192, torch.device("cpu")), at_once(8192, torch.device("cuda"))
    (8192, 131072)
    """
    return on_cpu if device.type == "cpu" else TIMES_OFF_CPU * on_cpu


def tiles(points: Tensor) -> Iterator[slice]:
    """Which rows go through wide layers together: a tile, or all where a gradient is wanted.

    A gradient makes one of whole weights for every tile.

    >>> with torch.no_grad():
    ...     [(rows.start, rows.stop) for rows in tiles(torch.zeros(1500, 3))]
    [(0, 1024), (1024, 1500)]
    """
    count = points.shape[0]
    tile = max(count, 1) if torch.is_grad_enabled() else at_once(TILE, points.device)
    for first in range(0, max(count, 1), tile):
        yield slice(first, min(first + tile, count))


__all__ = ["at_once", "tiles"]
