"""A baked actor: rendered in any pose from tables alone, without networks or pictures.

Two things are approximate. Pixel features are those of one category point per instance point,
averaged over the support poses, while the method's own field lets them slide with the pose's
deformation. And everything lies on grids.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.bricks import BrickGrid, BrickTable, brick_table, look_up
from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames
from actorsnerf_model.occupancy import CELL
from actorsnerf_model.offset_nodes import (
    OffsetNodes,
    offset_volume,
    offsets_at,
    offsets_in_pose,
)
from actorsnerf_model.posed_grid import (
    LEAST_LIKELIHOOD,
    PARTS,
    Anchors,
    FilledVoxels,
    PosedGrid,
    anchors,
    filled_voxels,
    posed_grid,
)
from actorsnerf_model.skinning import SkinningVolume, backward_warp
from actorsnerf_model.skinning_bounds import SkinningBounds, locate, skinning_bounds
from actorsnerf_model.states import FieldValues, Located, Occupancy, PoseState

PART_REACH = 0.6 * CELL / PARTS
"""Metres around the middle of a part of a posed cell: to its sides and a fifth more. Its corners
are farther, but a part that is filled in a corner alone hardly shows."""


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
    filled: FilledVoxels
    anchors: Anchors


@dataclass(frozen=True)
class BakedPose(PoseState):
    """The state of a pose, with the deformation and the backward warp in it."""

    offsets: Float[Tensor, "z y x 3"] | None
    """Of `offset_volume`, metres."""
    grid: PosedGrid


@torch.no_grad()
def baked_state(data: BakedActorData) -> BakedState:
    """The state of a baked actor, once per file."""
    filled = filled_voxels(data.field, PART_REACH)
    return BakedState(
        data,
        brick_table(data.field),
        skinning_bounds(data.skinning),
        filled,
        anchors(filled, data.skinning),
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
        """What depends on the pose alone."""
        data = actor.data
        motions, back = bone_motions(pose, rest_joints, data.canonical_joints)
        bounds = observation_bounds(posed_frames(pose, rest_joints)[1])
        offsets = None
        if data.offsets is not None:
            offsets = offset_volume(data.offsets, offsets_in_pose(data.offsets, pose))

        def rows_at(points: Tensor) -> Tensor:
            warped, likelihood = backward_warp(points, data.skinning, motions, actor.bounds.support)
            held = (likelihood > LEAST_LIKELIHOOD)[:, None]
            if data.offsets is not None and offsets is not None:
                warped = warped + offsets_at(warped, data.offsets, offsets)
            return torch.cat([warped * held, held.to(warped), likelihood[:, None]], -1)

        grid = posed_grid(actor.anchors, actor.filled, back, (bounds, data.threshold / 2), rows_at)
        return BakedPose(
            pose, motions, back, bounds, _occupancy(grid, data.threshold), offsets, grid
        )

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
    size = grid.low.new_tensor(grid.live.shape) * (grid.spacing / PARTS)
    return Occupancy(torch.stack([grid.low, grid.low + size]), grid.live, threshold)


def instance_points(
    actor: BakedState, pose: PoseState, points: Float[Tensor, "points 3"]
) -> Float[Tensor, "points 3"]:
    """Category points moved by the pose's deformation, metres."""
    assert isinstance(pose, BakedPose)
    if actor.data.offsets is None or pose.offsets is None:
        return points
    return points + offsets_at(points, actor.data.offsets, pose.offsets)


__all__ = [
    "BakedActor",
    "BakedActorData",
    "BakedPose",
    "BakedState",
    "baked_state",
    "instance_points",
]
