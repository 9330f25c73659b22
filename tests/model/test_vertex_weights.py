from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.kinematics import bone_motions
from actorsnerf_model.skinning import blend
from actorsnerf_model.vertex_weights import (
    DISTANCE_SCALE,
    HOLDING,
    bone_distances,
    on_simplex,
    recovered_weights,
)

Views = Callable[..., tuple[View, ...]]


def test_distances_are_to_segments(rest_joints: Tensor) -> None:
    knee, ankle, head = rest_joints[4], rest_joints[7], rest_joints[15]
    middle, across = (knee + ankle) / 2, torch.linalg.cross(knee - ankle, rest_joints.new_ones(3))
    beside = middle + 0.07 * across / across.norm()
    above = head + torch.tensor([0.0, 0.2, 0.0])
    below = ankle + 0.3 * (ankle - knee) / (ankle - knee).norm()
    found = bone_distances(torch.stack([beside, above, ankle, below]), rest_joints)
    assert found[3, 4] == pytest.approx(0.3, abs=1e-12)
    assert found[0, 4] == pytest.approx(0.07, abs=1e-12)
    assert found[1, 15] == pytest.approx(0.2)
    # The ankle ends the shin and begins the foot.
    assert float(found[2, [4, 7]].max()) < 1e-12
    assert bool((found < 2.5).all())


def test_a_bone_without_length_is_a_point(rest_joints: Tensor) -> None:
    joints = rest_joints.clone()
    joints[22] = joints[20]
    found = bone_distances(joints[20:21] + 0.1, joints)
    assert found[0, 20] == pytest.approx(0.1 * 3**0.5)


def test_the_nearest_point_of_the_simplex(generator: torch.Generator) -> None:
    values = 2 * torch.randn(200, 5, generator=generator, dtype=torch.float64)
    found = on_simplex(values)
    low, high = values.amin(1) - 1, values.amax(1)
    for _ in range(100):  # the shift that makes the clamped entries sum to 1, by bisection
        middle = (low + high) / 2
        much = (values - middle[:, None]).clamp(min=0).sum(1) > 1
        low, high = torch.where(much, middle, low), torch.where(much, high, middle)
    torch.testing.assert_close(found, (values - low[:, None]).clamp(min=0), rtol=0, atol=1e-12)


@pytest.fixture
def blended(support_views: Views, rest_joints: Tensor, generator: torch.Generator) -> list[View]:
    """Views of a body whose vertices hang on several bones each, in poses far apart."""
    views = []
    rest = support_views(1, vertices=300, dtype=torch.float64)[0].rest_vertices
    near = bone_distances(rest, rest_joints).topk(3, largest=False).indices
    shares = torch.rand(300, 3, generator=generator, dtype=torch.float64) + 0.05
    shares = shares / shares.sum(1, keepdim=True)
    weights = torch.zeros(300, 24, dtype=torch.float64).scatter(1, near, shares)
    for view in support_views(5, vertices=300, dtype=torch.float64):
        joints = view.rest_joints * 1.03
        motions = bone_motions(3 * view.pose, joints, view.canonical_joints)[1]
        posed = blend(rest, weights, motions)
        views.append(
            replace(
                view,
                pose=3 * view.pose,
                rest_joints=joints,
                rest_vertices=rest,
                posed_vertices=posed,
            )
        )
    return views


def mean_error(weights: Tensor, view: View) -> float:
    motions = bone_motions(view.pose, view.rest_joints, view.canonical_joints)[1]
    posed = blend(view.rest_vertices, weights, motions)
    return float((posed - view.posed_vertices).norm(dim=1).mean())


def test_poses_tell_the_weights(blended: list[View]) -> None:
    weights = recovered_weights(tuple(blended[:3]))
    assert bool((weights >= 0).all())
    assert int((weights > 0).sum(1).max()) <= HOLDING
    torch.testing.assert_close(weights.sum(1), torch.ones(300, dtype=torch.float64))
    first = blended[0]
    near = bone_distances(first.rest_vertices, first.canonical_joints)
    guessed = torch.softmax(-near / DISTANCE_SCALE, 1)
    for view in blended[3:]:
        assert mean_error(weights, view) < 0.001
        assert mean_error(guessed, view) > 0.01
    assert mean_error(recovered_weights(tuple(blended[:1])), blended[3]) < 0.01


def test_where_poses_say_nothing_nearness_does(support_views: Views) -> None:
    view = support_views(1, vertices=40, dtype=torch.float64)[0]
    still = replace(view, pose=torch.zeros_like(view.pose), posed_vertices=view.rest_vertices)
    nearest = bone_distances(view.rest_vertices, view.canonical_joints).topk(4, largest=False)
    expected = torch.softmax(-nearest.values / DISTANCE_SCALE, 1)
    found = recovered_weights((still, still)).gather(1, nearest.indices)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-9)


def test_single_precision_in_and_out(support_views: Views) -> None:
    views = support_views(3)
    weights = recovered_weights(views)
    assert weights.dtype == torch.float32
    assert not weights.requires_grad
