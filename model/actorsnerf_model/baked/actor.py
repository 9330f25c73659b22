"""A baked actor: rendered in any pose from tables alone, without networks or pictures.

Two things are approximate. Pixel features are those of one category point per instance point,
averaged over the support poses, while the method's own field lets them slide with the pose's
deformation. And everything lies on grids.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.baked.bricks import BrickGrid, BrickTable, brick_table, look_up
from actorsnerf_model.baked.filled_voxels import Anchors, FilledVoxels, anchors, filled_voxels
from actorsnerf_model.baked.node_warp import LEVEL, warped
from actorsnerf_model.baked.offset_nodes import (
    OffsetNodes,
    offset_volume,
    offsets_at,
    offsets_in_pose,
)
from actorsnerf_model.baked.part_maps import PARTS
from actorsnerf_model.baked.posed_grid import CELL, PosedGrid, posed_grid
from actorsnerf_model.kinematics import motions_between, observation_bounds, posed_frames
from actorsnerf_model.skinning import SkinningVolume
from actorsnerf_model.skinning_bounds import SkinningBounds, locate, skinning_bounds
from actorsnerf_model.states import FieldValues, Located, Occupancy, PoseState

REACH = 2 * CELL / PARTS
"""Metres around a part's middle to which distances are told apart; a part whose image is larger
than that on every side is never stepped over."""
ANCHOR_WEIGHT = 0.5
"""Share of the threshold from which a bone's weight places an anchor."""


@dataclass(frozen=True)
class BakedActorData:
    """All that a baked actor is; what its file holds."""

    canonical_joints: Float[Tensor, "24 3"]
    skinning: SkinningVolume
    offsets: OffsetNodes | None
    """None where the method does not deform."""
    field: BrickGrid
    """At instance points."""
    threshold: float
    """Foreground likelihood below which there is nothing."""
    home_pose: Float[Tensor, "24 3"]
    """A pose that the actor was seen in, for whoever has no motion: the first support view's."""
    home_joints: Float[Tensor, "24 3"]
    """Rest joints of that view, metres."""


@dataclass(frozen=True)
class BakedState:
    """A baked actor with what is computed from it once."""

    data: BakedActorData
    table: BrickTable
    bounds: SkinningBounds
    support: Float[Tensor, "24 2 3"]
    """Each bone's box for `node_warp`."""
    filled: FilledVoxels
    anchors: Anchors


@dataclass(frozen=True)
class BakedPose(PoseState):
    """The state of a pose, with the deformation and the backward warp in it."""

    offsets: Float[Tensor, "3 z y x"] | None
    """Of `offset_volume`, metres."""
    grid: PosedGrid
    warp: Callable[[Float[Tensor, "3 points"]], Float[Tensor, "4 points"]]
    """Points of the posed body frame (metres) to places that are looked up, and likelihoods."""


@torch.no_grad()
def baked_state(data: BakedActorData) -> BakedState:
    """The state of a baked actor, once per file."""
    filled = filled_voxels(data.field, REACH)
    least = ANCHOR_WEIGHT * data.threshold
    return BakedState(
        data,
        brick_table(data.field),
        skinning_bounds(data.skinning),
        skinning_bounds(data.skinning, LEVEL).boxes,
        filled,
        anchors(filled, data.skinning, CELL, least),
    )


class BakedActor:
    """Implements the `Method` protocol of `states` for one baked actor; nothing learns."""

    reads_directions = False

    def actor_state(self, supports: tuple[View, ...], window: float) -> BakedState:
        """Never: support views become an actor through networks, which baking left behind.

        Raises:
            UserError: always.
        """
        raise UserError(
            f"A baked actor cannot be made anew of {len(supports)} support views: fit a "
            "checkpoint to them and bake that."
        )

    @torch.no_grad()
    def pose_state(
        self,
        actor: BakedState,
        pose: Float[Tensor, "24 3"],
        rest_joints: Float[Tensor, "24 3"],
    ) -> BakedPose:
        """What depends on the pose alone; in full precision whatever lies around it."""
        with torch.autocast(pose.device.type, enabled=False):
            return self._posed(actor, pose, rest_joints)

    def _posed(
        self,
        actor: BakedState,
        pose: Float[Tensor, "24 3"],
        rest_joints: Float[Tensor, "24 3"],
    ) -> BakedPose:
        data = actor.data
        frames = posed_frames(pose, rest_joints)
        motions, back = motions_between(*frames, data.canonical_joints)
        bounds = observation_bounds(frames[1])
        offsets = None
        if data.offsets is not None:
            offsets = offset_volume(data.offsets, offsets_in_pose(data.offsets, pose))

        def warp(points: Tensor) -> Tensor:
            found = warped(points, data.skinning, actor.support, motions)
            if data.offsets is not None and offsets is not None:
                found[:3] += offsets_at(found[:3], data.offsets, offsets)
            return found

        limits = (bounds, data.threshold)
        grid = posed_grid(actor.anchors, actor.filled, back, limits, warp)
        occupancy = _occupancy(grid, data.threshold)
        return BakedPose(pose, motions, back, bounds, occupancy, offsets, grid, warp)

    @torch.no_grad()
    def locate(
        self,
        actor: BakedState,
        pose: PoseState,
        points: Float[Tensor, "points 3"],
        threshold: float,
    ) -> Located:
        """The points (body frame) whose likelihood reaches the threshold, in canonical space."""
        volume = actor.data.skinning
        return locate(points, volume, actor.bounds, pose.canonical_from_body, threshold)

    @torch.no_grad()
    def field(self, actor: BakedState, pose: PoseState, located: Located) -> FieldValues:
        """Colour and density at located points."""
        rgb, density = look_up(actor.table, instance_points(actor, pose, located.canonical))
        return FieldValues(rgb, density)


def _occupancy(grid: PosedGrid, threshold: float) -> Occupancy:
    """What the general renderer skips by: the live parts."""
    size = grid.low.new_tensor(grid.number.shape) * grid.edge
    return Occupancy(torch.stack([grid.low, grid.low + size]), grid.number >= 0, threshold)


def instance_points(
    actor: BakedState, pose: PoseState, points: Float[Tensor, "points 3"]
) -> Float[Tensor, "points 3"]:
    """Category points moved by the pose's deformation, metres."""
    assert isinstance(pose, BakedPose)
    if actor.data.offsets is None or pose.offsets is None:
        return points
    return points + offsets_at(points.T, actor.data.offsets, pose.offsets).T


__all__ = [
    "BakedActor",
    "BakedActorData",
    "BakedPose",
    "BakedState",
    "baked_state",
    "instance_points",
]
