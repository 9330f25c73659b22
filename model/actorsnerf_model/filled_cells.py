"""Where a fitted actor has any density, found once: the rest of its shell reaches no network.

Most samples that pass the foreground test lie in the air around the person. The field is asked at
nodes of a canonical grid, in a few poses; in another pose a sample in a cell all of whose corners
were empty then is skipped. What the deformation carries further than to a filled cell's border is
lost, so this is a saving with a stated error, which the report measures.

Per pose, occupied cells none of whose corners is in a filled cell or beside one are left out, and
then those eighths of the others whose middles are not, so that fewer samples in the air are ever
carried to canonical space.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.constants import constant
from actorsnerf_model.pieces import at_once
from actorsnerf_model.skinning import canonical_box
from actorsnerf_model.states import ActorState, Field, Located, Method, Occupancy, PoseState

CELL = 0.015
"""Edge of a cell, metres."""
LEAST_DENSITY = 0.05
"""1/metre under which a place counts as empty: half a permille of the light in a centimetre."""
REACH = 0.25
"""Share of the threshold down to which the body at rest is asked. Bones that meet in another pose
can carry a sample beyond: cells that nobody asked about count as filled."""
POINTS_AT_ONCE = 16384


@dataclass(frozen=True)
class FilledCells:
    """Cells of the canonical box that may hold density."""

    low: Float[Tensor, "3"]
    """Lower corner of the first cell, metres."""
    filled: Bool[Tensor, "z y x"]
    cell: float
    """Edge, metres."""


@dataclass(frozen=True)
class FilledActor(Generic[ActorState]):
    """A method's actor, and where it is."""

    actor: ActorState
    cells: FilledCells
    around: FilledCells
    """The same with the neighbours of filled cells."""


class SkipEmpty(Generic[ActorState]):
    """A method that passes over empty cells; implements the `Method` protocol of `states`."""

    def __init__(self, method: Method[ActorState]) -> None:
        self.method = method

    @property
    def reads_directions(self) -> bool:
        """The method's own."""
        return self.method.reads_directions

    def actor_state(self, supports: tuple[View, ...], window: float) -> FilledActor[ActorState]:
        """The method's own, and the cells filled in the support poses."""
        return self.filled(self.method.actor_state(supports, window), supports)

    def filled(
        self, actor: ActorState, supports: Sequence[View], threshold: float = 0.01
    ) -> FilledActor[ActorState]:
        """An actor whose state is there already, with its cells.

        Args:
            actor: the method's state.
            supports: views of the actor, in whose poses the field is asked.
            threshold: foreground likelihood below which a sample is empty anyway.
        """
        poses = [self.method.pose_state(actor, one.pose, one.rest_joints) for one in supports]
        rest = supports[0].canonical_joints
        poses.insert(0, self.method.pose_state(actor, torch.zeros_like(rest), rest))
        needed = REACH * threshold
        cells = filled_cells(self.method, actor, poses, canonical_box(rest), needed)
        near = F.max_pool3d(cells.filled[None].float(), 3, 1, 1)[0] > 0
        return FilledActor(actor, cells, replace(cells, filled=near))

    def pose_state(
        self,
        actor: FilledActor[ActorState],
        pose: Float[Tensor, "24 3"],
        rest_joints: Float[Tensor, "24 3"],
    ) -> PoseState:
        """The method's own, its occupied cells without those that nothing fills."""
        posed = self.method.pose_state(actor.actor, pose, rest_joints)
        if posed.occupancy is None:
            return posed
        return replace(posed, occupancy=self._filled_occupancy(actor, posed, posed.occupancy))

    @torch.no_grad()
    def _filled_occupancy(
        self, actor: FilledActor[ActorState], pose: PoseState, occupancy: Occupancy
    ) -> Occupancy:
        """The occupied cells near filled ones, halved along each axis.

        Kept are the cells with a corner in a filled cell or in a neighbour of one, and of these the
        eighths whose middle is: half an eighth's diagonal is less than a filled cell's edge. Where
        no bone holds the middle, the corner that the eighth has of the cell decides.
        """
        nodes = F.max_pool3d(F.pad(occupancy.cells[None].float(), [1] * 6), 2, 1)[0] > 0
        _, corner = self._near_filled(actor, pose, occupancy, nodes, 0.0)
        cells = occupancy.cells & (F.max_pool3d(corner[None].float(), 2, 1)[0] > 0)
        for axis in range(3):
            cells = cells.repeat_interleave(2, axis)
            corner = corner.repeat_interleave(2, axis).narrow(axis, 1, cells.shape[axis])
        halved = replace(occupancy, cells=cells)
        held, middle = self._near_filled(actor, pose, halved, cells, 0.5)
        return replace(halved, cells=middle | (cells & corner & ~held))

    def _near_filled(
        self,
        actor: FilledActor[ActorState],
        pose: PoseState,
        occupancy: Occupancy,
        asked: Bool[Tensor, "nx ny nz"],
        shift: float,
    ) -> tuple[Bool[Tensor, "nx ny nz"], Bool[Tensor, "nx ny nz"]]:
        """Which of the places that are asked about bones hold, and which lie near filled cells.

        Place (0, 0, 0) is the occupancy's lower corner, moved by `shift` cells along each axis.
        """
        edge = (occupancy.box[1] - occupancy.box[0]) / constant(occupancy.cells.shape, pose.bounds)
        held, near = torch.zeros_like(asked), torch.zeros_like(asked)
        places = asked.nonzero()
        for some in torch.split(places, at_once(POINTS_AT_ONCE, places.device)):
            points = occupancy.box[0] + edge * (some + shift)
            located = self.method.locate(actor.actor, pose, points, REACH * occupancy.threshold)
            found = some[located.index]
            held[found.unbind(-1)] = True
            near[found[may_hold(actor.around, located.canonical)].unbind(-1)] = True
        return held, near

    def locate(
        self,
        actor: FilledActor[ActorState],
        pose: PoseState,
        points: Float[Tensor, "points 3"],
        threshold: float,
    ) -> Located:
        """The method's located points, without those in empty cells."""
        located = self.method.locate(actor.actor, pose, points, threshold)
        kept = may_hold(actor.cells, located.canonical.detach()).nonzero()[:, 0]
        return Located(located.index[kept], located.canonical[kept], located.likelihood[kept])

    def field(self, actor: FilledActor[ActorState], pose: PoseState, located: Located) -> Field:
        """The method's own."""
        return self.method.field(actor.actor, pose, located)


@torch.no_grad()
def filled_cells(
    method: Method[ActorState],
    actor: ActorState,
    poses: Sequence[PoseState],
    box: Float[Tensor, "2 3"],
    threshold: float,
) -> FilledCells:
    """The cells with density at a corner in any of the poses.

    Args:
        method: in evaluation mode.
        actor: its state.
        poses: the first is the canonical pose itself, whose shell is asked.
        box: canonical box, metres.
        threshold: foreground likelihood in the canonical pose from which nodes are asked.
    """
    sizes = torch.ceil((box[1] - box[0]) / CELL).long().tolist()
    axes = [torch.arange(size + 1, device=box.device) for size in reversed(sizes)]
    holds = torch.ones([len(axis) for axis in axes], dtype=torch.bool, device=box.device)
    for z in range(holds.shape[0]):
        y, x = torch.meshgrid(axes[1], axes[2], indexing="ij")
        nodes = torch.stack([x, y, torch.full_like(x, z)], -1).reshape(-1, 3).to(box)
        shell = method.locate(actor, poses[0], box[0] + CELL * nodes, threshold)
        dense = torch.zeros_like(shell.likelihood, dtype=torch.bool)
        for pose in poses:
            for first in range(0, shell.index.shape[0], POINTS_AT_ONCE):
                part = slice(first, first + POINTS_AT_ONCE)
                some = Located(shell.index[part], shell.canonical[part], shell.likelihood[part])
                dense[part] |= method.field(actor, pose, some).density >= LEAST_DENSITY
        holds[z].view(-1)[shell.index] = dense
    return FilledCells(box[0], F.max_pool3d(holds[None, None].float(), 2, 1)[0, 0] > 0, CELL)


def may_hold(cells: FilledCells, points: Float[Tensor, "points 3"]) -> Bool[Tensor, "points"]:
    """Whether each canonical point lies in a cell that may hold density."""
    place = torch.floor((points - cells.low) / cells.cell).long()
    sizes = torch.tensor(list(reversed(cells.filled.shape)), device=points.device)
    x, y, z = place.clamp(torch.zeros_like(sizes), sizes - 1).unbind(-1)
    return cells.filled[z, y, x]


__all__ = ["FilledActor", "FilledCells", "SkipEmpty", "filled_cells", "may_hold"]
