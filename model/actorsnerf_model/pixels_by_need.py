"""Pixels drawn where the picture changes, and interpolated where their neighbours agree.

Every second pixel of every second row is drawn first. A pixel between drawn ones that agree, and
are inside the person, takes their mean; the others are drawn too. So outlines and thin limbs are
drawn, and what is lost is detail finer than the stride between places that look the same: a saving
with a stated error, and the larger the picture, the smaller it is.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

Draw = Callable[[Tensor], Tensor]
"""Flat pixel numbers to (pixels, channels)."""


@dataclass(frozen=True)
class Agreement:
    """When pixels are alike, channel by channel."""

    apart: Float[Tensor, "channels"]
    """By how much they may differ; infinite: as they like."""
    least: Float[Tensor, "channels"]
    """What each of them must reach; minus infinity: nothing."""


def by_need(
    draw: Draw,
    where: Bool[Tensor, "height width"],
    values: Float[Tensor, "height width channels"],
    stride: int,
    agree: Agreement,
) -> Float[Tensor, "height width channels"]:
    """The picture, drawn where it is needed.

    Args:
        draw: the channels of pixels, given as row * width + column, ascending.
        where: pixels that may show anything.
        values: what all others show, and in the same tensor's other places anything.
        stride: pixels between the first drawn ones; a power of 2.
        agree: when the drawn pixels around another one stand for it.
    """
    height, width = where.shape
    picture = values.reshape(height * width, -1)
    x, y = torch.arange(width, device=where.device), torch.arange(height, device=where.device)
    first = where & (x % stride == 0) & (y % stride == 0)[:, None]
    picture = _drawn(draw, picture, first.reshape(-1).nonzero()[:, 0])
    while stride > 1:
        step = stride // 2
        finer = (x % step == 0) & (y % step == 0)[:, None]
        coarser = (x % stride == 0) & (y % stride == 0)[:, None]
        number = (where & finer & ~coarser).reshape(-1).nonzero()[:, 0]
        around, whole = _neighbours(number, (width, height), step)
        seen = picture[around]
        least, most = seen.amin(1), seen.amax(1)
        same = whole & ((most - least <= agree.apart) & (least >= agree.least)).all(-1)
        picture = picture.index_copy(0, number[same], seen[same].mean(1))
        picture = _drawn(draw, picture, number[~same])
        stride = step
    return picture.reshape(values.shape)


def _drawn(
    draw: Draw, picture: Float[Tensor, "pixels channels"], number: Int[Tensor, "chosen"]
) -> Float[Tensor, "pixels channels"]:
    return picture.index_copy(0, number, draw(number)) if number.shape[0] else picture


def _neighbours(
    number: Int[Tensor, "pixels"], size: tuple[int, int], step: int
) -> tuple[Int[Tensor, "pixels 4"], Bool[Tensor, "pixels"]]:
    """The coarser grid's pixels around each one, twice where only two are; False at the border."""
    width, height = size
    x, y = number % width, torch.div(number, width, rounding_mode="floor")
    aside, below = step * (x % (2 * step) > 0), step * (y % (2 * step) > 0)
    whole = (x + aside < width) & (y + below < height)
    right = torch.where(x + aside < width, x + aside, x - aside)
    down = torch.where(y + below < height, y + below, y - below)
    pairs = [(b * width + a) for b in (y - below, down) for a in (x - aside, right)]
    return torch.stack(pairs, -1), whole


__all__ = ["Agreement", "Draw", "by_need"]
