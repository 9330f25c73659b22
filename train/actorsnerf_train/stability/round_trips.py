"""There and back: canonical points warped to random poses and home again, by region of the body.

The two warps are no inverses where bones blend (the paper's own approximation), so the error is
recorded, region by region; where one bone acts they are, and the error is rounding.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from tqdm import tqdm

from actorsnerf_datasets.skeleton import JOINT_NAMES, PARENTS
from actorsnerf_model.interpolation import trilinear
from actorsnerf_model.kinematics import bone_motions
from actorsnerf_model.skinning import (
    LEAST_SUM,
    SkinningVolume,
    blend,
    bone_weights,
    forward_warp,
    nodes_from_canonical,
)
from actorsnerf_model.skinning_prior import grid_nodes
from actorsnerf_train.stability.hard_poses import dance_poses

REGIONS = {
    "trunk": ("pelvis", "spine", "collar"),
    "head": ("neck", "head"),
    "thighs": ("hip",),
    "shins": ("knee",),
    "feet": ("ankle", "foot"),
    "upper arms": ("shoulder",),
    "forearms": ("elbow",),
    "hands": ("wrist", "hand"),
}
"""By the joint on which a place hangs."""
ONE_BONE = 1 - 1e-6
"""Share of the weight beyond which one bone acts."""
ONE_BONE_BOUND = 1e-5
"""Metres: how far such a point may come home from where it left."""
POINTS = 360
AT_ONCE = 100
"""Poses that are carried together."""
SEED = 20


@dataclass(frozen=True)
class RegionError:
    """How far a region's points come home from where they left."""

    region: str
    trips: int
    """Points times poses."""
    median: float
    """Metres, as all errors."""
    high: float
    """95 of 100 are nearer."""
    largest: float
    lost: float
    """Share of the trips whose posed point fails the foreground test."""
    finite: bool
    one_bone_trips: int
    one_bone_largest: float
    """Of the trips where one bone acts both ways; 0 where there are none."""


@dataclass(frozen=True)
class _Traveller:
    """A body whose points travel."""

    volume: SkinningVolume
    joints: Float[Tensor, "24 3"]
    points: Float[Tensor, "points 3"]
    region: Int[Tensor, "points"]


@dataclass(frozen=True)
class _Trips:
    error: Float[Tensor, "poses points"]
    likelihood: Float[Tensor, "poses points"]
    alone: Bool[Tensor, "poses points"]
    """Where one bone acts, there and back."""


@torch.no_grad()
def round_trips(
    volume: SkinningVolume,
    joints: Float[Tensor, "24 3"],
    vertices: Float[Tensor, "vertices 3"],
    threshold: float,
    count: int,
) -> tuple[RegionError, ...]:
    """The errors of every region over random dance-like poses.

    Args:
        volume: skinning weights.
        joints: at rest, canonical frame, metres.
        vertices: at rest; an even share of them travels.
        threshold: foreground likelihood.
        count: poses.
    """
    traveller = _traveller(volume, joints, vertices)
    poses = dance_poses(count, torch.Generator().manual_seed(SEED)).to(joints)
    trips = _travel(traveller, poses)
    names = list(REGIONS)
    rows = [_summed(name, trips, traveller.region == i, threshold) for i, name in enumerate(names)]
    rows.append(_summed("all", trips, traveller.region >= 0, threshold))
    return tuple(row for row in rows if row.trips > 0)


def one_bone_volume(volume: SkinningVolume, joints: Float[Tensor, "24 3"]) -> SkinningVolume:
    """A volume in which every node belongs to its nearest bone alone.

    Args:
        volume: its box and size are taken.
        joints: canonical frame, metres.
    """
    sizes = volume.weights.shape[1:]
    grid = grid_nodes(volume.box, (sizes[0], sizes[1], sizes[2])).reshape(-1, 3)
    nearest = torch.full((len(grid),), torch.inf).to(grid)
    owner = torch.zeros(len(grid), dtype=torch.long, device=grid.device)
    for joint, parent in enumerate(PARENTS):
        if parent < 0:
            continue
        start, way = joints[parent], joints[joint] - joints[parent]
        along = ((grid - start) * way).sum(-1) / (way * way).sum().clamp(min=1e-12)
        away = (grid - start - along.clamp(0, 1)[:, None] * way).norm(dim=-1)
        owner = torch.where(away < nearest, parent, owner)
        nearest = nearest.minimum(away)
    weights = torch.zeros_like(volume.weights).reshape(24, -1)
    weights[owner, torch.arange(len(grid), device=grid.device)] = 1
    return replace(volume, weights=weights.reshape(volume.weights.shape))


def _traveller(
    volume: SkinningVolume, joints: Float[Tensor, "24 3"], vertices: Float[Tensor, "vertices 3"]
) -> _Traveller:
    step = max(len(vertices) // POINTS, 1)
    points = vertices[::step]
    shares = _held(points, volume)
    inside = shares.sum(-1) > 0
    points, shares = points[inside], shares[inside]
    of_joint = torch.tensor([_region(name) for name in JOINT_NAMES], device=points.device)
    return _Traveller(volume, joints, points, of_joint[shares.argmax(-1)])


def _region(joint: str) -> int:
    plain = joint.removeprefix("left_").removeprefix("right_").rstrip("123")
    (found,) = [i for i, names in enumerate(REGIONS.values()) if plain in names]
    return found


def _held(points: Float[Tensor, "points 3"], volume: SkinningVolume) -> Float[Tensor, "points 24"]:
    return trilinear(volume.rows, nodes_from_canonical(points, volume))


def _travel(traveller: _Traveller, poses: Float[Tensor, "poses 24 3"]) -> _Trips:
    volume, points = traveller.volume, traveller.points
    held = _held(points, volume)
    alone_there = held.amax(-1) >= ONE_BONE * held.sum(-1)
    errors, likelihoods, alone = [], [], []
    for motions, posed in _posed(traveller, poses):
        weights = bone_weights(posed, volume, motions)
        likelihood = weights.sum(0)
        share = weights / likelihood.clamp(min=LEAST_SUM)
        home = blend(posed, share.T, motions)
        errors.append((home - points).norm(dim=-1))
        likelihoods.append(likelihood)
        alone.append(alone_there & (share.amax(0) >= ONE_BONE))
    return _Trips(torch.stack(errors), torch.stack(likelihoods), torch.stack(alone))


def _posed(
    traveller: _Traveller, poses: Float[Tensor, "poses 24 3"]
) -> Iterator[tuple[Tensor, Tensor]]:
    """`canonical_from_body` and posed points of each pose."""
    joints = traveller.joints
    with tqdm(total=len(poses), desc="warps", unit="pose", leave=False) as bar:
        for part in torch.split(poses, AT_ONCE):
            rest = joints.expand(len(part), 24, 3)
            there, back = bone_motions(part, rest, joints)
            moved, _ = forward_warp(traveller.points, traveller.volume, back)
            yield from zip(there, moved, strict=True)
            bar.update(len(part))


def _summed(
    region: str, trips: _Trips, which: Bool[Tensor, "points"], threshold: float
) -> RegionError:
    error, likelihood = trips.error[:, which], trips.likelihood[:, which]
    finite = bool(torch.isfinite(error).all() and torch.isfinite(likelihood).all())
    # A point that fails the foreground test is never rendered: it counts as lost, not as wrong.
    found = error[likelihood >= threshold]
    lonely = trips.alone[:, which] & (likelihood >= threshold)
    alone = error[lonely]
    ordered = found.sort().values
    return RegionError(
        region,
        error.numel(),
        _rank(ordered, 0.5),
        _rank(ordered, 0.95),
        _rank(ordered, 1.0),
        1 - len(found) / max(error.numel(), 1),
        finite,
        len(alone),
        float(alone.max()) if len(alone) else 0.0,
    )


def _rank(ordered: Float[Tensor, "values"], share: float) -> float:
    if len(ordered) == 0:
        return 0.0
    return float(ordered[min(int(share * len(ordered)), len(ordered) - 1)])


__all__ = ["ONE_BONE_BOUND", "REGIONS", "RegionError", "one_bone_volume", "round_trips"]
