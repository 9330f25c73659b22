"""Skinning: which bone moves which point, and the two warps between a posed and the canonical body.

The weights live in a volume over the canonical box, 24 bones and a background (dropped after the
softmax). Names as in the paper: W_b is a bone's weight, M_b its motion from posed to canonical.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_model.interpolation import corners, trilinear

BOX_MARGIN = (0.2, 0.2, 1.0)
"""Share of the joints' extent added on each side of the canonical box in x, y, z (released code).
The flat T-pose has little extent in z."""
LEAST_EXTENT = 0.05
"""Metres: what counts as the joints' extent in an axis in which they all but coincide."""
LEAST_SUM = 1e-4
"""Weights are divided by their sum or by this, whichever is larger (released code)."""
LEAST_FORWARD_SUM = 1e-12
"""The same for the forward warp; so small that a point in the box never shrinks to the origin."""


@dataclass(frozen=True)
class SkinningVolume:
    """How strongly each bone holds each place of the canonical box."""

    weights: Float[Tensor, "24 z y x"]
    """Non-negative, at most 1 in sum (the rest is background); nodes include the box's faces."""
    box: Float[Tensor, "2 3"]
    """Lower and upper corner, canonical frame, metres."""


def canonical_box(canonical_joints: Float[Tensor, "24 3"]) -> Float[Tensor, "2 3"]:
    """The box of the canonical body: the joints' extent and `BOX_MARGIN` of it on each side."""
    low, high = canonical_joints.amin(0), canonical_joints.amax(0)
    margin = (high - low).clamp(min=LEAST_EXTENT) * low.new_tensor(BOX_MARGIN)
    return torch.stack([low - margin, high + margin])


def skinning_volume(
    residual: Float[Tensor, "25 z y x"],
    log_prior: Float[Tensor, "25 z y x"],
    box: Float[Tensor, "2 3"],
) -> SkinningVolume:
    """The volume softmax(residual + ln prior), without its background channel.

    Args:
        residual: learned logits; zero gives the prior.
        log_prior: of `skinning_prior.log_prior`.
        box: canonical box of both.
    """
    return SkinningVolume(torch.softmax(residual + log_prior, 0)[:24], box)


def nodes_from_canonical(
    points: Float[Tensor, "*batch 3"], volume: SkinningVolume
) -> Float[Tensor, "*batch 3"]:
    """Canonical points (metres) in units of the volume's nodes, x, y, z."""
    last = points.new_tensor([size - 1 for size in reversed(volume.weights.shape[1:])])
    return (points - volume.box[0]) * (last / (volume.box[1] - volume.box[0]))


def carry(
    points: Float[Tensor, "points 3"], motions: Float[Tensor, "24 4 4"]
) -> Float[Tensor, "points 24 3"]:
    """Each point moved by each bone. Written out, so that a point's result ignores its company."""
    x, y, z = (points[:, None, None, axis] for axis in range(3))
    matrix = motions[:, :3]
    return x * matrix[..., 0] + y * matrix[..., 1] + z * matrix[..., 2] + matrix[..., 3]


def bone_weights(
    points: Float[Tensor, "points 3"],
    volume: SkinningVolume,
    canonical_from_body: Float[Tensor, "24 4 4"],
) -> Float[Tensor, "points 24"]:
    """W_b at the place to which bone b carries each point; zero outside the canonical box.

    A bone is asked only about points that it carries into the box.

    Args:
        points: posed body frame, metres.
        volume: skinning weights.
        canonical_from_body: the bones' motions.
    """
    nodes = nodes_from_canonical(carry(points, canonical_from_body), volume)
    sizes = nodes.new_tensor(list(reversed(volume.weights.shape[1:])))
    inside = ((nodes > -1) & (nodes < sizes)).all(-1)
    return weights_of_pairs(nodes, inside, volume)


def weights_of_pairs(
    nodes: Float[Tensor, "points 24 3"], asked: Bool[Tensor, "points 24"], volume: SkinningVolume
) -> Float[Tensor, "points 24"]:
    """Each bone's weight at its own place of each point where asked, zero elsewhere.

    Args:
        nodes: places in units of the volume's nodes.
        asked: which (point, bone) pairs to look up.
        volume: skinning weights.
    """
    bone = asked.nonzero()[:, 1]
    sizes = tuple(volume.weights.shape[1:])
    index, share = corners(nodes[asked], sizes)
    index = index + (bone * (sizes[0] * sizes[1] * sizes[2]))[:, None]
    found = (volume.weights.reshape(-1)[index] * share).sum(-1)
    return found.new_zeros(asked.shape).masked_scatter(asked, found)


def backward_warp(
    points: Float[Tensor, "points 3"],
    volume: SkinningVolume,
    canonical_from_body: Float[Tensor, "24 4 4"],
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points"]]:
    """Canonical places of posed points, and how likely each is on the person.

    With y_b = M_b p and w_b = W_b[y_b]: x_c = sum w_b y_b / max(sum w_b, 1e-4); the likelihood is
    sum w_b. Points that no bone claims come near the origin with likelihood 0.

    Args:
        points: posed body frame, metres.
        volume: skinning weights.
        canonical_from_body: the bones' motions M_b.

    Returns:
        Canonical frame, metres; likelihoods in [0, 24]. Differentiable in all arguments.

    Source: paper, inverse skinning after HumanNeRF eq. 4; released code.
    """
    weights = bone_weights(points, volume, canonical_from_body)
    likelihood = weights.sum(-1)
    share = weights / likelihood.clamp(min=LEAST_SUM)[:, None]
    return blend(points, share, canonical_from_body), likelihood


def forward_warp(
    canonical: Float[Tensor, "points 3"],
    volume: SkinningVolume,
    body_from_canonical: Float[Tensor, "views 24 4 4"],
) -> tuple[Float[Tensor, "views points 3"], Bool[Tensor, "points"]]:
    """Posed places of canonical points in several poses, and whether any bone holds them.

    Linear blend skinning with the weights at the canonical point, divided by their sum. A point
    outside the volume has none: it stays where it is and is flagged, while the released code sends
    it to the posed frame's origin.

    Args:
        canonical: canonical frame, metres.
        volume: skinning weights, read once for all poses.
        body_from_canonical: the bones' motions in each pose.

    Returns:
        Posed body frames, metres; flags. Differentiable in all arguments.

    Source: paper, linear blend skinning; the division is the released code's.
    """
    rows = volume.weights.permute(1, 2, 3, 0).contiguous()
    weights = trilinear(rows, nodes_from_canonical(canonical, volume))
    total = weights.sum(-1)
    held = total > LEAST_FORWARD_SUM
    share = weights / total.clamp(min=LEAST_FORWARD_SUM)[:, None]
    moved = torch.stack([blend(canonical, share, motions) for motions in body_from_canonical])
    return torch.where(held[:, None], moved, canonical), held


def blend(
    points: Float[Tensor, "points 3"],
    share: Float[Tensor, "points 24"],
    motions: Float[Tensor, "24 4 4"],
) -> Float[Tensor, "points 3"]:
    """Points moved by their share-weighted mean motion; shares that sum to 0 give the origin."""
    with torch.autocast(points.device.type, enabled=False):  # half precision is centimetres off
        matrix = (share @ motions[:, :3].reshape(24, 12)).reshape(-1, 3, 4)
        return (matrix[..., :3] @ points[..., None])[..., 0] + matrix[..., 3]


__all__ = [
    "SkinningVolume",
    "backward_warp",
    "blend",
    "bone_weights",
    "canonical_box",
    "carry",
    "forward_warp",
    "nodes_from_canonical",
    "skinning_volume",
    "weights_of_pairs",
]
