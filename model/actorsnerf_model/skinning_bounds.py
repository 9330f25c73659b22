"""Where each bone can matter, and the points that can pass the foreground test.

A bone matters only near itself: its box holds every place where its weight reaches `level`. Outside
all boxes 24 weights below the level sum to less than the threshold, so a point is thrown away
without a single look-up, and no point that passes the test is ever lost.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.constants import constant
from actorsnerf_model.pieces import at_once
from actorsnerf_model.skinning import (
    SkinningVolume,
    backward_warp,
    inside_boxes,
    lookup_table,
    node_motions,
    nodes_from_canonical,
    weights_at,
)
from actorsnerf_model.states import Located

LEVEL = 0.01 / 24 / 10
"""Weight at which a bone's box ends: a tenth of what 24 bones need for the released threshold 0.01,
so that what the boxes leave out cannot hide more than a tenth of the threshold."""
SLACK = 1e-4
"""Metres around each box, far above float32 rounding at the size of a person."""
SUPPORT_LEVEL = 1e-10
"""Weight below which a bone is left out of the warp itself. 23 such weights move the likelihood by
less than 3e-9 and a point at the threshold by less than a micrometre: float32 rounding."""
POINTS_AT_ONCE = 8192
"""Points that are culled or warped together on a CPU: their 24 places each stay in its cache."""


@dataclass(frozen=True)
class SkinningBounds:
    """Where each bone's weight reaches a level; lower and upper corners, canonical frame, metres.

    +inf and -inf for a bone whose weight nowhere does.
    """

    boxes: Float[Tensor, "24 2 3"]
    """Where it reaches `level`."""
    support: Float[Tensor, "24 2 3"]
    """Where it reaches `SUPPORT_LEVEL`."""
    level: float


@torch.no_grad()
def skinning_bounds(volume: SkinningVolume, level: float = LEVEL) -> SkinningBounds:
    """Each bone's box; outside it the interpolated weight is below the level.

    A place inside a cell has at most the weight of the cell's largest corner, hence one node more
    on every side of the nodes that reach the level.

    Args:
        volume: skinning weights; its gradient is not asked for.
        level: weight.
    """
    return SkinningBounds(_boxes(volume, level), _boxes(volume, SUPPORT_LEVEL), level)


@torch.no_grad()
def possible(
    points: Float[Tensor, "points 3"],
    volume: SkinningVolume,
    bounds: SkinningBounds,
    canonical_from_body: Float[Tensor, "24 4 4"],
    threshold: float,
) -> Tensor:
    """Ascending indices of the points whose likelihood may reach the threshold.

    Every point whose likelihood does reach it is among them; each bone is asked only about points
    inside its box, and what it could hide outside is counted as present.

    Args:
        points: posed body frame, metres.
        volume: skinning weights.
        bounds: of this volume.
        canonical_from_body: the bones' motions.
        threshold: likelihood.
    """
    needed = threshold * (1 - 1e-4) - 24 * bounds.level
    if needed <= 0:
        return torch.arange(points.shape[0], device=points.device)
    motions = node_motions(volume, canonical_from_body).reshape(72, 4)
    table = lookup_table(volume)
    low, high = nodes_from_canonical(bounds.boxes, volume).unbind(1)
    kept = []
    # A GPU takes all of them: the host waits for the count of every piece's survivors.
    many = POINTS_AT_ONCE if points.device.type == "cpu" else max(points.shape[0], 1)
    for first in range(0, points.shape[0], many):
        piece = points[first : first + many]
        with torch.autocast(points.device.type, enabled=False):
            places = torch.addmm(motions[:, 3:], motions[:, :3], piece.T).reshape(3, 24, -1)
        weight = weights_at(places, inside_boxes(places, low, high), table).sum(0)
        kept.append((weight >= needed).nonzero()[:, 0] + first)
    return torch.cat(kept) if kept else torch.arange(0, device=points.device)


def locate(
    points: Float[Tensor, "points 3"],
    volume: SkinningVolume,
    bounds: SkinningBounds,
    canonical_from_body: Float[Tensor, "24 4 4"],
    threshold: float,
) -> Located:
    """The points whose likelihood reaches the threshold, in canonical space.

    The backward warp of all points followed by the test, to rounding; most points never reach it.
    With a threshold of 0 every point is returned, and every bone asked about it. Gradients reach
    the volume and the motions.

    Args:
        points: posed body frame, metres.
        volume: skinning weights.
        bounds: of this volume (or of an equal one).
        canonical_from_body: the bones' motions.
        threshold: likelihood.
    """
    index = possible(points, volume, bounds, canonical_from_body, threshold)
    support = bounds.support if threshold > 0 else None
    wants_gradient = torch.is_grad_enabled() and any(
        tensor.requires_grad for tensor in (points, volume.weights, canonical_from_body)
    )
    # A gradient is as large as the volume, so there are no pieces where one is wanted.
    pieces = (
        (index,)
        if wants_gradient
        else torch.split(index, 4 * at_once(POINTS_AT_ONCE, index.device))
    )
    kept, canonical, likelihood = [], [], []
    for piece in pieces:
        place, likely = backward_warp(points[piece], volume, canonical_from_body, support)
        keep = (likely >= threshold).nonzero()[:, 0]
        kept.append(piece[keep])
        canonical.append(place[keep])
        likelihood.append(likely[keep])
    return Located(torch.cat(kept), torch.cat(canonical), torch.cat(likelihood))


def _boxes(volume: SkinningVolume, level: float) -> Float[Tensor, "24 2 3"]:
    """Each bone's box of nodes that reach a level, one node wider, in metres."""
    reached = volume.weights >= level
    last = [size - 1 for size in reversed(volume.weights.shape[1:])]
    spacing = (volume.box[1] - volume.box[0]) / constant(last, volume.box)
    lows, highs = [], []
    for others in ((1, 2), (1, 3), (2, 3)):  # along x, y, z
        along = reached.any(others[1]).any(others[0])
        node = torch.arange(along.shape[1], dtype=spacing.dtype, device=along.device)
        lows.append(torch.where(along, node, torch.inf).amin(1))
        highs.append(torch.where(along, node, -torch.inf).amax(1))
    low = volume.box[0] + (torch.stack(lows, -1) - 1) * spacing - SLACK
    high = volume.box[0] + (torch.stack(highs, -1) + 1) * spacing + SLACK
    return torch.stack([low, high], 1)


__all__ = ["LEVEL", "SUPPORT_LEVEL", "SkinningBounds", "locate", "possible", "skinning_bounds"]
