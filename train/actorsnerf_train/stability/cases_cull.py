"""Hard cases of culling: nobody who passes the foreground test is lost, nobody else is kept."""

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames
from actorsnerf_model.skinning import SkinningVolume, backward_warp
from actorsnerf_model.skinning_bounds import locate
from actorsnerf_model.states import Occupancy
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject
from actorsnerf_train.stability.hard_poses import named_poses

NONE = Bounds(0.0, 0.0, 0.0)
UNSURE = 1e-4
"""Relative distance from the threshold under which float32 may decide either way."""
POINTS = 20000
"""Random points of each pose's bounds."""


def cull_cases(subject: Subject) -> list[Case]:
    """The cases; the subject tells only the fastest poses."""
    fast = {f"fastest frame {i + 1}": pose for i, pose in enumerate(subject.poses.double().cpu())}
    poses = {**named_poses(), **fast}
    cases = [_decided(name, pose) for name, pose in poses.items()]
    return cases + [_emptied(name, pose) for name, pose in poses.items()]


def _decided(name: str, pose: Float[Tensor, "24 3"]) -> Case:
    """Points a hair above and below the threshold, found by bisection from in- to outside."""

    def answer(subject: Subject) -> Answer:
        points, above = _brink(subject, pose)
        joints = subject.supports[0].canonical_joints
        there, _ = bone_motions(subject.tensor(pose), joints, joints)
        body = subject.state.body
        threshold = subject.options.threshold
        found = locate(points, body.skinning, body.bounds, there, threshold)
        kept = torch.zeros_like(above).index_fill_(0, found.index, True)
        note = f"{len(above)} points within 0.1 % of the threshold"
        return Answer(joints.new_tensor([float((kept != above).sum())]), note=note)

    def truth(subject: Subject) -> Answer:
        return Answer(subject.like.new_zeros(1))

    measured = "points lost or won at likelihood 0.999 and 1.001 of the threshold"
    return Case("threshold", name, measured, NONE, answer, truth)


def _brink(subject: Subject, pose: Float[Tensor, "24 3"]) -> tuple[Tensor, Tensor]:
    """Points just above and just below the threshold, and which are above."""
    volume = subject.state.body.skinning
    double = SkinningVolume(volume.weights.double(), volume.box.double())
    joints = subject.supports[0].canonical_joints.double()
    there, _ = bone_motions(pose.to(joints), joints, joints)
    generator = torch.Generator().manual_seed(3)
    inside = posed_frames(pose.to(joints), joints)[1].repeat(2, 1)
    way = torch.randn(inside.shape, generator=generator, dtype=torch.float64).to(inside)
    outside = inside + 3 * way / way.norm(dim=-1, keepdim=True)
    sides = []
    for share in (1.001, 0.999):
        wanted, low, high = share * subject.options.threshold, inside, outside
        for _ in range(60):
            middle = (low + high) / 2
            person = backward_warp(middle, double, there)[1] >= wanted
            low = torch.where(person[:, None], middle, low)
            high = torch.where(person[:, None], high, middle)
        sides.append(low.float().to(subject.like))
    points = torch.cat(sides)
    likely = backward_warp(points.double(), double, there)[1]
    beyond = likely / subject.options.threshold - 1
    # A bone's sharp edge jumps over the brink; what is not near it says nothing.
    telling = (beyond.abs() < 2e-3) & (beyond.abs() > UNSURE)
    return points[telling], beyond[telling] > 0


def _emptied(name: str, pose: Float[Tensor, "24 3"]) -> Case:
    """Points of the person must lie in cells that count as occupied."""

    def answer(subject: Subject) -> Answer:
        joints = subject.supports[0].canonical_joints
        state = subject.method.pose_state(subject.state, subject.tensor(pose), joints)
        points, person = _people(subject, pose)
        lost = 0
        if state.occupancy is not None:
            lost = int((person & ~_occupied(points, state.occupancy)).sum())
        note = f"{int(person.sum())} of {POINTS} random points are on the person"
        return Answer(joints.new_tensor([float(lost)]), note=note)

    def truth(subject: Subject) -> Answer:
        return Answer(subject.like.new_zeros(1))

    return Case("cull", name, "points of the person in empty cells", NONE, answer, truth)


def _people(subject: Subject, pose: Float[Tensor, "24 3"]) -> tuple[Tensor, Tensor]:
    """Random points of the pose's bounds, and which are surely on the person."""
    volume = subject.state.body.skinning
    double = SkinningVolume(volume.weights.double(), volume.box.double())
    joints = subject.supports[0].canonical_joints.double()
    given = pose.to(joints)
    low, high = observation_bounds(posed_frames(given, joints)[1])
    share = torch.rand(POINTS, 3, generator=torch.Generator().manual_seed(9), dtype=torch.float64)
    points = low + (high - low) * share.to(low)
    likely = backward_warp(points, double, bone_motions(given, joints, joints)[0])[1]
    return points, likely >= subject.options.threshold * (1 + UNSURE)


def _occupied(points: Float[Tensor, "points 3"], occupancy: Occupancy) -> Tensor:
    sizes = torch.tensor(occupancy.cells.shape, device=points.device)
    low, high = occupancy.box.double()
    cell = ((points - low) / (high - low) * sizes).floor().long()
    cell = cell.minimum(sizes - 1).clamp(min=0)
    return occupancy.cells[tuple(cell.unbind(-1))]


__all__ = ["cull_cases"]
