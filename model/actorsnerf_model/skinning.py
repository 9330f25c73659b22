"""Skinning: which bone moves which point, and the two warps between a posed and the canonical body.

The weights live in a volume over the canonical box, 24 bones and a background (dropped after the
softmax). Names as in the paper: W_b is a bone's weight, M_b its motion from posed to canonical.
"""

from dataclasses import dataclass, field

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_model.constants import constant
from actorsnerf_model.interpolation import trilinear

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
    rows: Float[Tensor, "z y x 24"] = field(init=False)
    """The weights again, all bones of a node side by side: what the forward warp reads."""

    def __post_init__(self) -> None:
        """Lays the weights out once, not at every look."""
        object.__setattr__(self, "rows", self.weights.permute(1, 2, 3, 0).contiguous())


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
    return (points - volume.box[0]) * _nodes_per_metre(volume)


def node_motions(
    volume: SkinningVolume, canonical_from_body: Float[Tensor, "24 4 4"]
) -> Float[Tensor, "3 24 4"]:
    """The bones' motions from the posed body frame (metres) straight to the volume's nodes.

    Rows of the matrices first: a lookup wants all bones' x together, then y, then z.
    """
    scale = _nodes_per_metre(volume)
    shift = torch.zeros_like(canonical_from_body[:, :3])
    shift[..., 3] = volume.box[0]
    return ((canonical_from_body[:, :3] - shift) * scale[:, None]).transpose(0, 1)


def bone_places(
    points: Float[Tensor, "points 3"], motions: Float[Tensor, "3 24 4"]
) -> Float[Tensor, "3 24 points"]:
    """Where each bone carries each point. Written out, so that a point's result is its own alone.

    A matrix product rounds by the number of its rows, and a point near the threshold would pass
    or fail with its company.
    """
    x, y, z = points.T.contiguous().unbind(0)
    a, b, c, d = motions[..., None].unbind(2)
    return a * x + b * y + c * z + d


def lookup_table(volume: SkinningVolume) -> Float[Tensor, "24 z y x"]:
    """The weights with a layer of zeros on every side, so that every cell has all its corners."""
    return F.pad(volume.weights, (1, 1, 1, 1, 1, 1))


def inside_boxes(
    places: Float[Tensor, "3 24 points"],
    low: Float[Tensor, "24 3"],
    high: Float[Tensor, "24 3"],
) -> Bool[Tensor, "24 points"]:
    """True where a bone's place of a point is in the bone's box; never in one of inf to -inf."""
    middle = ((low + high) / 2).nan_to_num(0.0).T[..., None]
    away = (places - middle).abs() - ((high - low) / 2).T[..., None]
    return away[0].maximum(away[1]).maximum(away[2]) <= 0


def weights_at(
    places: Float[Tensor, "3 24 points"],
    asked: Bool[Tensor, "24 points"],
    table: Float[Tensor, "24 z y x"],
) -> Float[Tensor, "24 points"]:
    """Each bone's weight at its own place of each point where asked, zero elsewhere.

    Args:
        places: in units of the volume's nodes; at most one outside the volume where asked.
        asked: which pairs of bone and point to look up.
        table: of `lookup_table`.
    """
    pair = asked.reshape(-1).nonzero()[:, 0]
    cell = pair // places.shape[2]
    share = []
    for axis in (2, 1, 0):
        place = places[axis].reshape(-1).index_select(0, pair)
        size = table.shape[3 - axis]
        low = place.detach().floor().clamp(-1, size - 3)
        share.append(place - low)
        cell = cell * size + (low.long() + 1)
    step = torch.arange(2, device=cell.device)
    height, width = table.shape[2:]
    corner = (step[:, None, None] * height + step[:, None]) * width + step
    # One-dimensional index_select is several times faster than indexing.
    index = (cell + corner.reshape(8, 1)).reshape(-1)
    values = table.reshape(-1).index_select(0, index).reshape(2, 2, 2, -1)
    for part in share:
        values = torch.lerp(values[0], values[1], part)
    return values.new_zeros(asked.numel()).scatter(0, pair, values).reshape(asked.shape)


def bone_weights(
    points: Float[Tensor, "points 3"],
    volume: SkinningVolume,
    canonical_from_body: Float[Tensor, "24 4 4"],
    support: Float[Tensor, "24 2 3"] | None = None,
) -> Float[Tensor, "24 points"]:
    """W_b at the place to which bone b carries each point; zero outside the canonical box.

    Args:
        points: posed body frame, metres.
        volume: skinning weights.
        canonical_from_body: the bones' motions.
        support: ask each bone only about places in its box (canonical frame, metres); None asks
            about the whole canonical box.
    """
    places = bone_places(points, node_motions(volume, canonical_from_body))
    sizes = constant(volume.weights.shape[:0:-1], places)
    low, high = torch.full_like(sizes, -1).expand(24, 3), sizes.expand(24, 3)
    if support is not None:
        inner = nodes_from_canonical(support, volume)
        low, high = inner[:, 0].maximum(low), inner[:, 1].minimum(high)
    return weights_at(places, inside_boxes(places, low, high), lookup_table(volume))


def backward_warp(
    points: Float[Tensor, "points 3"],
    volume: SkinningVolume,
    canonical_from_body: Float[Tensor, "24 4 4"],
    support: Float[Tensor, "24 2 3"] | None = None,
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points"]]:
    """Canonical places of posed points, and how likely each is on the person.

    With y_b = M_b p and w_b = W_b[y_b]: x_c = sum w_b y_b / max(sum w_b, 1e-4); the likelihood is
    sum w_b. Points that no bone claims come near the origin with likelihood 0.

    Args:
        points: posed body frame, metres.
        volume: skinning weights.
        canonical_from_body: the bones' motions M_b.
        support: boxes outside which a bone's weight counts as 0; None for none.

    Returns:
        Canonical frame, metres; likelihoods in [0, 24]. Differentiable in all arguments.

    Source: paper, inverse skinning after HumanNeRF eq. 4; released code.
    """
    weights = bone_weights(points, volume, canonical_from_body, support)
    likelihood = weights.sum(0)
    share = weights / likelihood.clamp(min=LEAST_SUM)
    return blend(points, share.T, canonical_from_body), likelihood


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
    weights = trilinear(volume.rows, nodes_from_canonical(canonical, volume))
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


def _nodes_per_metre(volume: SkinningVolume) -> Float[Tensor, "3"]:
    last = constant([size - 1 for size in reversed(volume.weights.shape[1:])], volume.box)
    return last / (volume.box[1] - volume.box[0])


__all__ = [
    "SkinningVolume",
    "backward_warp",
    "blend",
    "bone_places",
    "bone_weights",
    "canonical_box",
    "forward_warp",
    "inside_boxes",
    "lookup_table",
    "node_motions",
    "nodes_from_canonical",
    "skinning_volume",
    "weights_at",
]
