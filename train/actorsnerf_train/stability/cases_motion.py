"""Hard cases of rotations and of the skeleton in motion."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets import rotations as exact_rotations
from actorsnerf_datasets.skeleton import joint_transforms
from actorsnerf_model.kinematics import bone_motions
from actorsnerf_model.rotations import matrix_from_axis_angle
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject
from actorsnerf_train.stability.hard_poses import named_poses, wound_up

ANGLES = {
    "0": 0.0,
    "1e-8": 1e-8,
    "1e-4": 1e-4,
    "0.1, where the series ends": 0.1,
    "pi - 1e-6": math.pi - 1e-6,
    "pi": math.pi,
    "2 pi": 2 * math.pi,
    "beyond 2 pi": 2 * math.pi + 0.7,
    "4 pi": 4 * math.pi,
}
ORTHOGONAL = Bounds(1e-12, 1e-6, 1e-6)
TURNED = Bounds(1e-12, 3e-6, 3e-6, gradient=1e-5)
"""Rounding a float32 angle of 4 pi moves it by 5e-7 rad."""
DERIVATIVE = Bounds(1e-7, 1e-5, 1e-5)
"""The float64 truth is a difference quotient, good to about 1e-9."""
DIFFERENCE = 1e-5
"""Radians, of the difference quotient."""
MOTION = Bounds(1e-12, 5e-6, 5e-6, gradient=3e-4)
"""In the T-pose most of the gradient cancels, and what is left has lost float32 digits."""
AXES = ((1, 0, 0), (0, 1, 0), (0, 0, -1), (1, 1, 1), (-0.3, 0.8, 0.1), (1, -1, 1e-3))


def motion_cases(subject: Subject) -> list[Case]:
    """The cases; the subject tells only the fastest poses."""
    cases = []
    for name, angle in ANGLES.items():
        turns = _turns(angle)
        cases += [_orthogonal(name, turns), _turned(name, turns), _derivative(name, turns)]
    fast = {f"fastest frame {i + 1}": pose for i, pose in enumerate(subject.poses.double().cpu())}
    cases += [_moved(name, pose) for name, pose in {**named_poses(), **fast}.items()]
    for name, pose in named_poses().items():
        if bool(pose.any()):
            cases.append(_moved(f"{name}, a turn more", wound_up(pose)))
    for name, factor in (("half size", 0.5), ("twice the size", 2.0), ("mirrored", -1.0)):
        cases.append(_moved(f"rest joints of other betas: {name}", named_poses()["splits"], factor))
    return cases


def _turns(angle: float) -> Float[Tensor, "axes 3"]:
    axes = torch.tensor(AXES, dtype=torch.float64)
    turns: Tensor = angle * axes / axes.norm(dim=-1, keepdim=True)
    return turns


def _orthogonal(name: str, turns: Float[Tensor, "axes 3"]) -> Case:
    def answer(subject: Subject) -> Answer:
        matrix = matrix_from_axis_angle(subject.tensor(turns)).double()
        return Answer(matrix @ matrix.transpose(-1, -2))

    def truth(subject: Subject) -> Answer:
        return Answer(torch.eye(3, dtype=torch.float64).expand(len(turns), 3, 3).to(subject.like))

    return Case("rotation", f"angle {name}", "max abs R R^T - 1", ORTHOGONAL, answer, truth)


def _turned(name: str, turns: Float[Tensor, "axes 3"]) -> Case:
    def answer(subject: Subject) -> Answer:
        given = subject.tensor(turns).requires_grad_()
        matrix = matrix_from_axis_angle(given)
        return Answer(matrix.detach(), _gradients(_mixed(matrix), given))

    def truth(subject: Subject) -> Answer:
        return Answer(_exact(subject.tensor(turns)))

    return Case("rotation", f"angle {name}", "R against quaternions", TURNED, answer, truth)


def _derivative(name: str, turns: Float[Tensor, "axes 3"]) -> Case:
    def answer(subject: Subject) -> Answer:
        given = subject.tensor(turns).requires_grad_()
        (gradient,) = _gradients(_mixed(matrix_from_axis_angle(given)), given)
        return Answer(gradient)

    def truth(subject: Subject) -> Answer:
        given = subject.tensor(turns)
        step = DIFFERENCE * torch.eye(3, dtype=given.dtype, device=given.device)
        columns = [
            (_per_turn(_exact(given + one)) - _per_turn(_exact(given - one))) / (2 * DIFFERENCE)
            for one in step
        ]
        return Answer(torch.stack(columns, -1))

    measured = "derivative of R against a difference quotient"
    return Case("rotation", f"angle {name}", measured, DERIVATIVE, answer, truth)


def _moved(name: str, pose: Float[Tensor, "24 3"], factor: float = 1.0) -> Case:
    def answer(subject: Subject) -> Answer:
        given = subject.tensor(pose).requires_grad_()
        joints = subject.supports[0].canonical_joints
        there, back = bone_motions(given, factor * joints, joints)
        loss = _mixed(there) + _mixed(back)
        return Answer(torch.stack([there, back]).detach(), _gradients(loss, given))

    def truth(subject: Subject) -> Answer:
        joints = subject.supports[0].canonical_joints
        rest = factor * joints
        angles = subject.tensor(pose).cpu().numpy()
        exact = torch.from_numpy(joint_transforms(angles, rest.cpu().numpy())).to(joints)
        # From the canonical joint to this body's own, then as the skeleton moves it.
        exact[:, :3, 3] += (exact[:, :3, :3] @ (rest - joints)[..., None])[..., 0]
        return Answer(torch.stack([torch.linalg.inv(exact), exact]))

    return Case("motion", name, "bone motions against numpy's (m)", MOTION, answer, truth)


def _exact(turns: Tensor) -> Tensor:
    matrix = exact_rotations.matrix_from_axis_angle(turns.double().cpu().numpy())
    return torch.from_numpy(matrix).to(turns)


def _per_turn(matrices: Float[Tensor, "turns 3 3"]) -> Float[Tensor, "turns"]:
    return (matrices * _mixture(matrices)).sum((-1, -2))


def _mixed(values: Tensor) -> Tensor:
    return (values * _mixture(values)).sum()


def _mixture(values: Tensor) -> Tensor:
    """Uneven weights for the last two axes, so that no derivative cancels."""
    rows, columns = values.shape[-2:]
    count = torch.arange(rows * columns, dtype=values.dtype, device=values.device)
    return torch.sin(1 + 2.3 * count).reshape(rows, columns)


def _gradients(loss: Tensor, *inputs: Tensor) -> tuple[Tensor, ...]:
    return torch.autograd.grad(loss, inputs)


__all__ = ["motion_cases"]
