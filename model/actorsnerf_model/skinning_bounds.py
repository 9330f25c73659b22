"""Where each bone can matter, and the points that can pass the foreground test.

A bone matters only near itself: its box holds every place where its weight reaches `level`. Outside
all boxes 24 weights below the level sum to less than the threshold, so a point is thrown away
without a single look-up, and no point that passes the test is ever lost.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.skinning import (
    SkinningVolume,
    backward_warp,
    nodes_from_canonical,
    weights_of_pairs,
)
from actorsnerf_model.states import Located

LEVEL = 0.01 / 24 / 10
"""Weight at which a bone's box ends: a tenth of what 24 bones need for the released threshold 0.01,
so that what the boxes leave out cannot hide more than a tenth of the threshold."""
SLACK = 1e-4
"""Metres around each box, far above float32 rounding at the size of a person."""
POINTS_AT_ONCE = 32768
"""Points that are culled together; bounds the memory of 24 places for each."""


@dataclass(frozen=True)
class SkinningBounds:
    """Where each bone's weight reaches a level."""

    boxes: Float[Tensor, "24 2 3"]
    """Lower and upper corners, canonical frame, metres; +inf and -inf for a bone with none."""
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
    reached = volume.weights >= level
    spacing = (volume.box[1] - volume.box[0]) / volume.box.new_tensor(
        [size - 1 for size in reversed(volume.weights.shape[1:])]
    )
    lows, highs = [], []
    for axis in (3, 2, 1):  # x, y, z
        others = tuple(other for other in (1, 2, 3) if other != axis)
        along = reached.any(others[1]).any(others[0])
        node = torch.arange(along.shape[1], device=along.device).expand_as(along)
        node = node.to(volume.box.dtype)
        lows.append(torch.where(along, node, torch.inf).amin(1))
        highs.append(torch.where(along, node, -torch.inf).amax(1))
    low = volume.box[0] + (torch.stack(lows, -1) - 1) * spacing - SLACK
    high = volume.box[0] + (torch.stack(highs, -1) + 1) * spacing + SLACK
    return SkinningBounds(torch.stack([low, high], 1), level)


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
    motions = canonical_from_body[:, :3].reshape(72, 4)
    kept = []
    for first in range(0, points.shape[0], POINTS_AT_ONCE):
        piece = points[first : first + POINTS_AT_ONCE]
        with torch.autocast(points.device.type, enabled=False):
            places = torch.addmm(motions[:, 3], piece, motions[:, :3].T).reshape(-1, 24, 3)
        inside = ((places >= bounds.boxes[:, 0]) & (places <= bounds.boxes[:, 1])).all(-1)
        nodes = nodes_from_canonical(places, volume)
        weight = weights_of_pairs(nodes, inside, volume).sum(-1)
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

    Equal to the backward warp of all points followed by the test; most points never reach it. With
    a threshold of 0 every point is returned. Gradients reach the volume and the motions.

    Args:
        points: posed body frame, metres.
        volume: skinning weights.
        bounds: of this volume (or of an equal one).
        canonical_from_body: the bones' motions.
        threshold: likelihood.
    """
    index = possible(points, volume, bounds, canonical_from_body, threshold)
    canonical, likelihood = backward_warp(points[index], volume, canonical_from_body)
    keep = (likelihood >= threshold).nonzero()[:, 0]
    return Located(index[keep], canonical[keep], likelihood[keep])


__all__ = ["LEVEL", "SkinningBounds", "locate", "possible", "skinning_bounds"]
