from typing import TYPE_CHECKING

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor
from torch.autograd import gradcheck

from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames
from actorsnerf_model.skinning import (
    SkinningVolume,
    backward_warp,
    bone_weights,
    canonical_box,
    forward_warp,
    skinning_volume,
)
from actorsnerf_model.skinning_prior import log_prior

if TYPE_CHECKING:
    from tests.model.conftest import ToyScene


def spread(bounds: Tensor, count: int, generator: torch.Generator) -> Tensor:
    share = torch.rand(count, 3, generator=generator, dtype=torch.float64).to(bounds.dtype)
    return bounds[0] + (bounds[1] - bounds[0]) * share


def dense_twin(points: Tensor, volume: SkinningVolume, motions: Tensor) -> tuple[Tensor, Tensor]:
    """One bone after another, all points, `grid_sample`, as the formula is written."""
    total = torch.zeros_like(points[:, 0])
    place = torch.zeros_like(points)
    for bone in range(24):
        there = points @ motions[bone, :3, :3].T + motions[bone, :3, 3]
        grid = 2 * (there - volume.box[0]) / (volume.box[1] - volume.box[0]) - 1
        weight = F.grid_sample(
            volume.weights[None, bone : bone + 1], grid[None, None, None], align_corners=True
        ).reshape(-1)
        total = total + weight
        place = place + weight[:, None] * there
    return place / total.clamp(min=1e-4)[:, None], total


def test_the_canonical_box_by_hand(rest_joints: Tensor) -> None:
    box = canonical_box(rest_joints)
    low, high = [-1.064, -1.468, -0.21], [1.064, 0.688, 0.24]
    torch.testing.assert_close(box, torch.tensor([low, high], dtype=torch.float64))


def test_a_flat_skeleton_still_has_a_box() -> None:
    box = canonical_box(torch.zeros(24, 3))
    assert (box[1] > box[0]).all()


def test_weights_are_a_softmax_without_background(
    generator: torch.Generator, rest_joints: Tensor
) -> None:
    box = canonical_box(rest_joints)
    residual = torch.randn(25, 4, 4, 4, generator=generator, dtype=torch.float64)
    prior = log_prior(rest_joints, box, (4, 4, 4))
    weights = skinning_volume(residual, prior, box).weights
    raw = torch.exp(residual + prior)
    torch.testing.assert_close(weights, raw[:24] / raw.sum(0))


def test_backward_equals_the_dense_twin(generator: torch.Generator, scene64: "ToyScene") -> None:
    points = spread(scene64.pose.bounds, 2000, generator)
    volume, motions = scene64.actor.volume, scene64.pose.canonical_from_body
    found = backward_warp(points, volume, motions)
    expected = dense_twin(points, volume, motions)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)
    assert (found[1] > 0.01).sum() > 50


def test_backward_in_single_precision(
    generator: torch.Generator, scene: "ToyScene", scene64: "ToyScene"
) -> None:
    points = spread(scene64.pose.bounds, 2000, generator)
    volume = SkinningVolume(scene64.actor.volume.weights.float(), scene64.actor.volume.box.float())
    motions = scene64.pose.canonical_from_body
    exact = backward_warp(points, scene64.actor.volume, motions)
    found = backward_warp(points.float(), volume, motions.float())
    person = exact[1] >= 0.01
    assert (found[1] - exact[1]).abs().max() < 1e-5
    assert (found[0] - exact[0])[person].abs().max() < 1e-4


def test_gradients_of_both_warps(generator: torch.Generator, rest_joints: Tensor) -> None:
    volume = skinning_volume(
        torch.randn(25, 3, 3, 3, generator=generator, dtype=torch.float64),
        torch.zeros(25, 3, 3, 3, dtype=torch.float64),
        canonical_box(rest_joints),
    )
    pose = 0.3 * torch.randn(24, 3, generator=generator, dtype=torch.float64)
    there, back = bone_motions(pose, rest_joints, rest_joints)
    points = spread(volume.box, 3, generator).requires_grad_()
    weights = volume.weights.detach()[:, :, :2].requires_grad_()

    def backward(points: Tensor, weights: Tensor, there: Tensor) -> tuple[Tensor, Tensor]:
        return backward_warp(points, SkinningVolume(weights, volume.box), there)

    def forward(points: Tensor, weights: Tensor, back: Tensor) -> Tensor:
        return forward_warp(points, SkinningVolume(weights, volume.box), back)[0]

    assert gradcheck(backward, (points, weights, there.detach().requires_grad_()), fast_mode=True)
    assert gradcheck(
        forward, (points, weights, back.detach()[None].requires_grad_()), fast_mode=True
    )


def test_round_trip_where_one_bone_acts(generator: torch.Generator, rest_joints: Tensor) -> None:
    """With one bone alone in the volume the warps are inverse to rounding, in float32."""
    joints = rest_joints.float()
    box = canonical_box(joints)
    pose = torch.randn(24, 3, generator=generator)
    pose[0] = 0
    there, back = bone_motions(pose, joints, joints)
    for bone in range(24):
        weights = torch.zeros(24, 4, 4, 4)
        weights[bone] = 0.7
        volume = SkinningVolume(weights, box)
        canonical = spread(box, 200, generator)
        posed, held = forward_warp(canonical, volume, back[None])
        again, likelihood = backward_warp(posed[0], volume, there)
        assert held.all()
        inside = likelihood > 0.69  # rounding may push a point on a face outside
        assert inside.float().mean() > 0.9
        assert (again - canonical)[inside].norm(dim=-1).max() <= 1e-5


def test_forward_to_many_poses_is_forward_to_each(
    generator: torch.Generator, rest_joints: Tensor, scene64: "ToyScene"
) -> None:
    poses = 0.4 * torch.randn(3, 24, 3, generator=generator, dtype=torch.float64)
    joints = rest_joints.expand(3, 24, 3)
    _, back = bone_motions(poses, joints, rest_joints)
    points = spread(scene64.actor.volume.box, 50, generator)
    moved, _ = forward_warp(points, scene64.actor.volume, back)
    for each in range(3):
        alone, _ = forward_warp(points, scene64.actor.volume, back[each : each + 1])
        torch.testing.assert_close(moved[each], alone[0], rtol=0, atol=1e-13)


def test_points_outside_the_volume_stay_and_are_flagged(scene64: "ToyScene") -> None:
    box = scene64.actor.volume.box
    outside = torch.stack([box[1] + 1, box[0] - 5, (box[0] + box[1]) / 2])
    outside.requires_grad_()
    moved, held = forward_warp(
        outside, scene64.actor.volume, scene64.pose.body_from_canonical[None]
    )
    assert held.tolist() == [False, False, True]
    torch.testing.assert_close(moved[0, :2], outside[:2])
    torch.autograd.backward(moved.sum())
    assert outside.grad is not None
    assert torch.isfinite(outside.grad).all()


def test_points_that_no_bone_claims(scene64: "ToyScene") -> None:
    far = torch.full((2, 3), 50.0, dtype=torch.float64, requires_grad=True)
    canonical, likelihood = backward_warp(
        far, scene64.actor.volume, scene64.pose.canonical_from_body
    )
    assert likelihood.tolist() == [0, 0]
    assert torch.isfinite(canonical).all()
    torch.autograd.backward(canonical.sum() + likelihood.sum())
    assert far.grad is not None
    assert torch.isfinite(far.grad).all()


def test_corners_and_faces_of_the_canonical_box(scene64: "ToyScene") -> None:
    box = scene64.actor.volume.box
    unit = torch.cartesian_prod(*[torch.tensor([0.0, 0.5, 1.0], dtype=torch.float64)] * 3)
    points = (box[0] + unit * (box[1] - box[0])).requires_grad_()
    still = torch.eye(4, dtype=torch.float64).expand(24, 4, 4)
    canonical, likelihood = backward_warp(points, scene64.actor.volume, still)
    moved, _ = forward_warp(points, scene64.actor.volume, still[None])
    assert torch.isfinite(canonical).all()
    torch.testing.assert_close(moved[0], points, rtol=0, atol=1e-12)
    torch.autograd.backward(canonical.sum() + likelihood.sum() + moved.sum())
    assert points.grad is not None
    assert torch.isfinite(points.grad).all()


@pytest.mark.parametrize("hard", ["folded", "upside down", "wound", "straight down"])
def test_hard_poses_are_finite(
    generator: torch.Generator, rest_joints: Tensor, scene64: "ToyScene", hard: str
) -> None:
    pose = torch.zeros(24, 3, dtype=torch.float64)
    match hard:
        case "folded":
            pose[1:, 0] = 3.0
        case "upside down":
            pose[1] = pose[2] = torch.tensor([torch.pi, 0, 0])
        case "wound":
            pose[1:] = 20 * torch.randn(23, 3, generator=generator, dtype=torch.float64)
        case "straight down":
            rest_joints[4] = rest_joints[1] - torch.tensor([0.0, 0.4, 0.0])
    there, back = bone_motions(pose, rest_joints, scene64.actor.canonical_joints)
    points = spread(observation_bounds(posed_frames(pose, rest_joints)[1]), 500, generator)
    points.requires_grad_()
    canonical, likelihood = backward_warp(points, scene64.actor.volume, there)
    moved, _ = forward_warp(canonical, scene64.actor.volume, back[None])
    torch.autograd.backward(moved.sum() + likelihood.sum())
    assert points.grad is not None
    for found in (canonical, likelihood, moved, points.grad):
        assert torch.isfinite(found).all()


def test_weights_do_not_depend_on_the_company(
    generator: torch.Generator, scene: "ToyScene"
) -> None:
    points = spread(scene.pose.bounds, 300, generator)
    there, volume = scene.pose.canonical_from_body, scene.actor.volume
    together = bone_weights(points, volume, there)
    alone = torch.cat([bone_weights(part, volume, there) for part in torch.split(points, 7)], 1)
    assert torch.equal(together, alone)
