import dataclasses
from typing import TYPE_CHECKING

import pytest
import torch

from actorsnerf_model.kinematics import bone_motions
from actorsnerf_model.skinning import SkinningVolume, backward_warp, bone_weights
from actorsnerf_model.skinning_bounds import SUPPORT_LEVEL, locate, possible, skinning_bounds

if TYPE_CHECKING:
    from tests.model.conftest import ToyScene


def spread(bounds: torch.Tensor, count: int, generator: torch.Generator) -> torch.Tensor:
    share = torch.rand(count, 3, generator=generator, dtype=torch.float64).to(bounds.dtype)
    return bounds[0] + (bounds[1] - bounds[0]) * share


def random_motions(generator: torch.Generator, joints: torch.Tensor) -> torch.Tensor:
    pose = torch.randn(24, 3, generator=generator).to(joints.dtype)
    pose[0] = 0
    return bone_motions(pose, joints, joints)[0]


def test_a_single_node_by_hand() -> None:
    weights = torch.zeros(24, 5, 5, 5)
    weights[3, 2, 1, 4] = 0.5  # z, y, x
    volume = SkinningVolume(weights, torch.tensor([[0.0, 0, 0], [4, 8, 12]]))
    bounds = skinning_bounds(volume)
    torch.testing.assert_close(
        bounds.boxes[3], torch.tensor([[3.0, 0, 3], [5, 4, 9]]), rtol=0, atol=2e-4
    )
    assert (bounds.boxes[[0, 23], 0] == torch.inf).all()
    assert (bounds.boxes[[0, 23], 1] == -torch.inf).all()


def test_outside_a_box_the_weight_is_below_the_level(
    generator: torch.Generator, scene64: "ToyScene"
) -> None:
    volume = scene64.actor.volume
    bounds = skinning_bounds(volume, level=1e-3)
    points = spread(scene64.pose.bounds, 3000, generator)
    there = scene64.pose.canonical_from_body
    weights = bone_weights(points, volume, there).T
    places = torch.einsum("bij,pj->pbi", there[:, :3, :3], points) + there[:, :3, 3]
    inside = ((places >= bounds.boxes[:, 0]) & (places <= bounds.boxes[:, 1])).all(-1)
    assert weights[~inside].max() < 1e-3
    support = ((places >= bounds.support[:, 0]) & (places <= bounds.support[:, 1])).all(-1)
    assert weights[~support].max() < SUPPORT_LEVEL
    assert (inside <= support).all()
    assert inside.float().mean() < 0.3  # the boxes do save something


@pytest.mark.parametrize("threshold", [0.01, 0.05, 0.5, 0.002])
def test_no_point_that_passes_is_lost(
    generator: torch.Generator, scene: "ToyScene", threshold: float
) -> None:
    volume, bounds = scene.actor.volume, scene.actor.bounds
    for _ in range(4):
        there = random_motions(generator, scene.actor.canonical_joints)
        points = spread(scene.pose.bounds, 20_000, generator)
        canonical, likelihood = backward_warp(points, volume, there)
        passes = (likelihood >= threshold).nonzero()[:, 0]
        located = locate(points, volume, bounds, there, threshold)
        assert torch.equal(located.index, passes)
        assert (located.canonical - canonical[passes]).abs().max() <= 1e-6
        assert (located.likelihood - likelihood[passes]).abs().max() <= 1e-6


def test_little_is_kept_in_vain(generator: torch.Generator, scene: "ToyScene") -> None:
    points = spread(scene.pose.bounds, 20_000, generator)
    there = scene.pose.canonical_from_body
    kept = possible(points, scene.actor.volume, scene.actor.bounds, there, 0.01)
    located = locate(points, scene.actor.volume, scene.actor.bounds, there, 0.01)
    assert located.index.shape[0] <= kept.shape[0] < 1.2 * located.index.shape[0] + 20


@pytest.mark.parametrize("threshold", [0.0, -1.0])
def test_no_threshold_keeps_every_point(
    generator: torch.Generator, scene: "ToyScene", threshold: float
) -> None:
    points = spread(scene.pose.bounds, 500, generator)
    there = scene.pose.canonical_from_body
    located = locate(points, scene.actor.volume, scene.actor.bounds, there, threshold)
    assert torch.equal(located.index, torch.arange(500))


def test_no_points_and_an_empty_volume(generator: torch.Generator, scene: "ToyScene") -> None:
    there, volume = scene.pose.canonical_from_body, scene.actor.volume
    assert locate(torch.zeros(0, 3), volume, scene.actor.bounds, there, 0.01).index.shape == (0,)
    empty = dataclasses.replace(volume, weights=torch.zeros_like(volume.weights))
    points = spread(scene.pose.bounds, 100, generator)
    located = locate(points, empty, skinning_bounds(empty), there, 0.01)
    assert located.canonical.shape == (0, 3)


def test_gradients_are_those_of_the_warp(generator: torch.Generator, scene64: "ToyScene") -> None:
    points = spread(scene64.pose.bounds, 3000, generator)
    there = scene64.pose.canonical_from_body
    actor = scene64.method.actor_state((), 0.0)
    located = locate(points, actor.volume, actor.bounds, there, 0.01)
    found = torch.autograd.grad(
        (located.canonical.sin().sum() + located.likelihood.sum()), scene64.method.residual
    )[0]
    actor = scene64.method.actor_state((), 0.0)
    canonical, likelihood = backward_warp(points, actor.volume, there)
    person = likelihood >= 0.01
    loss = canonical[person].sin().sum() + likelihood[person].sum()
    expected = torch.autograd.grad(loss, scene64.method.residual)[0]
    assert (found - expected).norm() <= 1e-6 * expected.norm()


def test_just_below_and_above_the_threshold() -> None:
    weights = torch.zeros(24, 2, 2, 2)
    weights[0], weights[1] = 0.006, 0.004 - 1e-6
    box = torch.tensor([[-1.0, -1, -1], [1, 1, 1]])
    still = torch.eye(4).expand(24, 4, 4)
    point = torch.zeros(1, 3)
    volume = SkinningVolume(weights, box)
    bounds = skinning_bounds(volume)
    assert locate(point, volume, bounds, still, 0.01).index.shape == (0,)
    assert locate(point, volume, bounds, still, 0.01 - 2e-6).index.shape == (1,)
