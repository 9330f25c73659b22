"""Hard cases of skinning: the prior, rows of zeros, the threshold, the box's corners, the warps."""

import math
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames
from actorsnerf_model.skinning import (
    SkinningVolume,
    backward_warp,
    canonical_box,
    forward_warp,
    skinning_volume,
)
from actorsnerf_model.skinning_bounds import locate, skinning_bounds
from actorsnerf_model.skinning_prior import bone_prior, log_prior
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject
from actorsnerf_train.stability.hard_poses import named_poses

WARP = Bounds(1e-12, 1e-5, 1e-5, gradient=1e-3)
"""Metres, of a point that passes the foreground test: at likelihood 0.01 rounding counts a hundred
times."""
PRIOR = Bounds(1e-12, 1e-5, 1e-5)
EXACT = Bounds(0.0, 0.0, 0.0)
CORNERS = Bounds(1e-12, 1e-5, 1e-5)
POINTS = 400
NODES = (12, 12, 12)
"""Of the volumes that are made for one case."""
UNSURE = 1e-4
"""Relative distance from the threshold under which float32 may decide either way."""


def skinning_cases(subject: Subject) -> list[Case]:
    """The cases; the subject tells only the fastest poses."""
    fast = {f"fastest frame {i + 1}": pose for i, pose in enumerate(subject.poses.double().cpu())}
    poses = {**named_poses(), **fast}
    cases = [_warped(name, pose) for name, pose in poses.items()]
    for factor in (0.5, 2.0, -1.0):
        cases.append(_warped(f"splits, rest joints times {factor:g}", poses["splits"], factor))
    cases += [_zero_rows(), _nobody_holds(), _nothing_anywhere(), _box_corners()]
    cases += [_turned_prior(), _short_bones()]
    cases += [_child(0.3), _child(2.5), _flat_child(), _large_logits(1e4), _large_logits(80.0)]
    return cases


def pose_points(
    subject: Subject, pose: Float[Tensor, "24 3"], factor: float = 1.0
) -> tuple[Float[Tensor, "24 4 4"], Float[Tensor, "points 3"]]:
    """`canonical_from_body`, and points on, around and far from the posed body.

    Args:
        subject: whose body; points are the same at every precision.
        pose: axis-angle.
        factor: of the rest joints.
    """
    joints = subject.supports[0].canonical_joints
    given = subject.tensor(pose)
    there, _ = bone_motions(given, factor * joints, joints)
    generator = torch.Generator().manual_seed(7)
    exact = subject.supports[0].canonical_joints.double().cpu() * factor
    places = posed_frames(pose.double(), exact)[1]
    low, high = observation_bounds(places)
    # Not the joints themselves: some lie on the volume's cell walls, where gradients jump.
    near = places.repeat(POINTS // 24, 1)
    near = near + 0.06 * torch.randn(near.shape, generator=generator, dtype=torch.float64)
    anywhere = low + (high - low) * torch.rand(
        POINTS // 4, 3, generator=generator, dtype=torch.float64
    )
    return there, subject.tensor(torch.cat([near, anywhere]))


def _warped(name: str, pose: Float[Tensor, "24 3"], factor: float = 1.0) -> Case:
    def answer(subject: Subject) -> Answer:
        there, points = pose_points(subject, pose, factor)
        volume = subject.state.body.skinning
        weights = volume.weights.detach().clone().requires_grad_()
        there, points = there.detach().requires_grad_(), points.requires_grad_()
        held = SkinningVolume(weights, volume.box)
        canonical, likelihood = backward_warp(points, held, there)
        person = likelihood.detach() >= subject.options.threshold
        loss = (canonical[person].sin() * _uneven(canonical)).sum() + likelihood.sum()
        gradients = torch.autograd.grad(loss, (points, weights, there))
        values = torch.cat([canonical, likelihood[:, None]], -1).detach()
        return Answer(values, gradients, person, f"{int(person.sum())} points on the person")

    def truth(subject: Subject) -> Answer:
        there, points = pose_points(subject, pose, factor)
        values = slow_warp(points, subject.state.body.skinning, there)
        return Answer(values, counted=values[:, 3] >= subject.options.threshold * (1 + UNSURE))

    return Case("warp", name, "canonical place against a slow twin (m)", WARP, answer, truth)


def slow_warp(
    points: Float[Tensor, "points 3"],
    volume: SkinningVolume,
    canonical_from_body: Float[Tensor, "24 4 4"],
) -> Float[Tensor, "points 4"]:
    """Canonical places and likelihoods by `grid_sample` and a sum over bones, one by one."""
    likelihood = torch.zeros_like(points[:, 0])
    total = torch.zeros_like(points)
    for bone in range(24):
        motion = canonical_from_body[bone]
        place = points @ motion[:3, :3].T + motion[:3, 3]
        normal = 2 * (place - volume.box[0]) / (volume.box[1] - volume.box[0]) - 1
        weight = F.grid_sample(
            volume.weights[None, bone : bone + 1], normal[None, :, None, None], align_corners=True
        )[0, 0, :, 0, 0]
        likelihood = likelihood + weight
        total = total + weight[:, None] * place
    return torch.cat([total / likelihood.clamp(min=1e-4)[:, None], likelihood[:, None]], -1)


def _zero_rows() -> Case:
    """A third of the volume holds nothing: no bone, and no background either."""

    def answer(subject: Subject) -> Answer:
        there, points = pose_points(subject, named_poses()["crouching"])
        volume = subject.state.body.skinning
        weights = volume.weights.detach().clone()
        weights[:, ::3] = 0
        weights.requires_grad_()
        points = points.requires_grad_()
        canonical, likelihood = backward_warp(points, SkinningVolume(weights, volume.box), there)
        gradients = torch.autograd.grad(canonical.sum() + likelihood.sum(), (points, weights))
        return Answer(torch.cat([canonical, likelihood[:, None]], -1).detach(), gradients)

    def truth(subject: Subject) -> Answer:
        there, points = pose_points(subject, named_poses()["crouching"])
        volume = subject.state.body.skinning
        weights = volume.weights.clone()
        weights[:, ::3] = 0
        values = slow_warp(points, replace(volume, weights=weights), there)
        return Answer(values, counted=values[:, 3] >= subject.options.threshold)

    return Case("skinning", "rows of zeros", "canonical place (m)", replace(WARP, gradient=None),
                answer, truth)  # fmt: skip


def _nobody_holds() -> Case:
    """Canonical points that no bone holds stay where they are, in every pose."""

    def answer(subject: Subject) -> Answer:
        body = subject.state.body
        corner = body.geometry.box.clone().requires_grad_()
        weights = torch.zeros_like(body.skinning.weights).requires_grad_()
        volume = SkinningVolume(weights, body.skinning.box)
        moved, held = forward_warp(corner, volume, body.body_from_canonical)
        gradients = torch.autograd.grad(moved.sum(), (corner, weights))
        return Answer((moved - corner).detach(), gradients, note=f"{int(held.sum())} held")

    def truth(subject: Subject) -> Answer:
        return Answer(torch.zeros_like(subject.state.body.body_from_canonical[:, :2, 0, :3]))

    return Case(
        "skinning", "no bone holds the point", "way that it moves (m)", EXACT, answer, truth
    )


def _nothing_anywhere() -> Case:
    """A volume of zeros has no bounds, and nobody is found."""

    def answer(subject: Subject) -> Answer:
        there, points = pose_points(subject, named_poses()["splits"])
        volume = subject.state.body.skinning
        empty = replace(volume, weights=torch.zeros_like(volume.weights))
        found = locate(points, empty, skinning_bounds(empty), there, subject.options.threshold)
        return Answer(found.canonical.new_tensor([float(len(found.index))]))

    def truth(subject: Subject) -> Answer:
        return Answer(subject.like.new_zeros(1))

    return Case("skinning", "a volume of zeros", "points found", EXACT, answer, truth)


def _box_corners() -> Case:
    """At the canonical box's corners and face middles the weight is the node's own."""

    def answer(subject: Subject) -> Answer:
        volume = _cubic(subject)
        unit = torch.cartesian_prod(*[volume.box.new_tensor([0.0, 0.5, 1.0])] * 3)
        points = volume.box[0] + unit * (volume.box[1] - volume.box[0])
        still = torch.eye(4).to(points).expand(24, 4, 4)
        points = points.requires_grad_()
        _, likelihood = backward_warp(points, volume, still)
        # A point rounded out of the box is in the cell between the face and the zeros around it.
        return Answer(likelihood.detach(), torch.autograd.grad(likelihood.sum(), (points,)))

    def truth(subject: Subject) -> Answer:
        middle = (NODES[0] - 1) / 2
        low, high = math.floor(middle), math.ceil(middle)
        weights = _cubic(subject).weights.sum(0)
        for axis in range(3):
            three = [weights.select(axis, 0), weights.select(axis, -1)]
            between = (weights.select(axis, low) + weights.select(axis, high)) / 2
            weights = torch.stack([three[0], between, three[1]], axis)
        return Answer(weights.permute(2, 1, 0).reshape(-1))

    return Case("skinning", "the box's corners, edges and faces", "likelihood", CORNERS, answer,
                truth)  # fmt: skip


def _cubic(subject: Subject) -> SkinningVolume:
    """A smooth volume in the actor's box, the same at every precision."""
    count = torch.arange(24 * math.prod(NODES), dtype=torch.float64)
    weights = (0.5 + 0.5 * torch.sin(0.37 * count)).reshape(24, *NODES) / 24
    return SkinningVolume(subject.tensor(weights), subject.state.body.skinning.box)


def _turned_prior() -> Case:
    """A body turned so that its bones point straight down has the same prior, turned."""

    def answer(subject: Subject) -> Answer:
        joints = subject.supports[0].canonical_joints
        box = canonical_box(joints)
        # x to -y, y to x: the arms hang straight down.
        turned = torch.stack([joints[:, 1], -joints[:, 0], joints[:, 2]], -1)
        low, high = box
        turned_box = torch.stack(
            [torch.stack([low[1], -high[0], low[2]]), torch.stack([high[1], -low[0], high[2]])]
        )
        prior = bone_prior(turned, turned_box, NODES)
        return Answer(prior.flip(2).transpose(2, 3))

    def truth(subject: Subject) -> Answer:
        joints = subject.supports[0].canonical_joints
        return Answer(bone_prior(joints, canonical_box(joints), NODES))

    return Case("prior", "bones pointing straight down", "share of a node, against the T-pose's",
                PRIOR, answer, truth)  # fmt: skip


def _short_bones() -> Case:
    """Every joint in one place: no bone has a direction, and still no share is NaN."""

    def answer(subject: Subject) -> Answer:
        joints = subject.supports[0].canonical_joints
        point = joints[:1].expand(24, 3).clone().requires_grad_()
        logits = log_prior(point, canonical_box(joints), NODES)
        gradient = torch.autograd.grad(torch.softmax(logits, 0)[:24].sum(), (point,))
        return Answer(logits.detach().exp(), gradient)

    return Case("prior", "bones without length", "share of a node", PRIOR, answer)


def _child(factor: float) -> Case:
    """The whole actor smaller or larger, volume, box and all."""

    def answer(subject: Subject) -> Answer:
        joints = factor * subject.supports[0].canonical_joints
        box = canonical_box(joints)
        logits = log_prior(joints, box, NODES).requires_grad_()
        volume = skinning_volume(torch.zeros_like(logits), logits, box)
        found = backward_warp(joints, volume, torch.eye(4).to(joints).expand(24, 4, 4))
        gradient = torch.autograd.grad(found[0].sum() + found[1].sum(), (logits,))
        return Answer(found[0].detach(), gradient)

    def truth(subject: Subject) -> Answer:
        return Answer(factor * subject.supports[0].canonical_joints)

    measured = "joints that warp elsewhere in the pose at rest (m)"
    bounds = replace(WARP, gradient=None)
    return Case("betas", f"an actor {factor:g} times as large", measured, bounds, answer, truth)


def _flat_child() -> Case:
    """Joints in one plane: the box keeps a depth."""

    def answer(subject: Subject) -> Answer:
        joints = subject.supports[0].canonical_joints.clone()
        joints[:, 2] = 0
        box = canonical_box(joints)
        logits = log_prior(joints, box, NODES)
        volume = skinning_volume(torch.zeros_like(logits), logits, box)
        found = backward_warp(joints, volume, torch.eye(4).to(joints).expand(24, 4, 4))
        return Answer(found[0])

    def truth(subject: Subject) -> Answer:
        joints = subject.supports[0].canonical_joints.clone()
        joints[:, 2] = 0
        return Answer(joints)

    measured = "joints that warp elsewhere in the pose at rest (m)"
    return Case("betas", "an actor without depth", measured, replace(WARP, gradient=None), answer,
                truth)  # fmt: skip


def _large_logits(size: float) -> Case:
    """Learned logits far beyond what training reaches."""

    def answer(subject: Subject) -> Answer:
        body = subject.state.body
        shape = body.geometry.log_prior.shape
        count = torch.arange(math.prod(shape), dtype=torch.float64).reshape(shape)
        logits = subject.tensor(size * torch.sin(1.7 * count)).requires_grad_()
        weights = skinning_volume(logits, body.geometry.log_prior, body.geometry.box).weights
        gradient = torch.autograd.grad(weights.square().sum(), (logits,))
        return Answer(weights.detach(), gradient)

    bounds = Bounds(0.0, 1e-2, 1e-2) if size > 100 else Bounds(0.0, 1e-4, 1e-4)
    measured = "skinning weights against float64"
    return Case("skinning", f"logits up to {size:g}", measured, bounds, answer)


def _uneven(values: Tensor) -> Tensor:
    return 1 + 0.5 * torch.arange(values.shape[-1], dtype=values.dtype, device=values.device)


__all__ = ["pose_points", "skinning_cases", "slow_warp"]
