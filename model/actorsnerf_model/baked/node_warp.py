"""The backward warp of many places around a posed body, fast: what a baked pose is made of."""

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.skinning import (
    SkinningVolume,
    bone_places,
    inside_boxes,
    lookup_table,
    node_motions,
    nodes_from_canonical,
    weights_at,
)

LEAST_LIKELIHOOD = 1e-5
"""Below it no bone holds a place; far below any threshold."""
LEVEL = 1e-6
"""Weight below which a bone is left out: at a threshold of 0.01 it moves a point by less than a
tenth of a millimetre."""
POINTS_AT_ONCE = 8192
"""Points whose 24 places stay in the cache together."""


@torch.no_grad()
def warped(
    points: Float[Tensor, "3 points"],
    volume: SkinningVolume,
    support: Float[Tensor, "24 2 3"],
    canonical_from_body: Float[Tensor, "24 4 4"],
) -> Float[Tensor, "4 points"]:
    """Canonical places (metres) of posed points, and their likelihoods; as `backward_warp`.

    Unlike there, the weights are divided by their sum however small, so that places next to the
    body vary as smoothly as those on it; what no bone holds comes to the box's corner.

    Args:
        points: posed body frame, metres.
        volume: skinning weights.
        support: each bone's box where its weight reaches `LEVEL`.
        canonical_from_body: the bones' motions.
    """
    motions = node_motions(volume, canonical_from_body)
    sizes = motions.new_tensor(list(reversed(volume.weights.shape[1:])))
    inner = nodes_from_canonical(support, volume)
    low = inner[:, 0].maximum(torch.full_like(sizes, -1))
    high = inner[:, 1].minimum(sizes)
    table = lookup_table(volume)
    per_node = (volume.box[1] - volume.box[0]) / (sizes - 1)
    found = []
    for piece in torch.split(points, POINTS_AT_ONCE, 1):
        places = bone_places(piece.T, motions)
        weights = weights_at(places, inside_boxes(places, low, high), table)
        likelihood = weights.sum(0)
        share = weights / likelihood.clamp(min=LEAST_LIKELIHOOD)
        place = (places * share).sum(1) * per_node[:, None] + volume.box[0][:, None]
        found.append(torch.cat([place, likelihood[None]]))
    return torch.cat(found, 1) if found else points.new_zeros(4, 0)


__all__ = ["LEAST_LIKELIHOOD", "LEVEL", "warped"]
