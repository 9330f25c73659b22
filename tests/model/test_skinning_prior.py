import math

import pytest
import torch

from actorsnerf_datasets.skeleton import BONES, PARENTS
from actorsnerf_model.skinning import canonical_box
from actorsnerf_model.skinning_prior import PRIOR_FLOOR, bone_prior, grid_nodes, log_prior

SIZES = (32, 32, 32)


def test_shares_sum_to_one(rest_joints: torch.Tensor) -> None:
    prior = bone_prior(rest_joints, canonical_box(rest_joints), SIZES)
    torch.testing.assert_close(prior.sum(0), torch.ones(SIZES, dtype=torch.float64))
    assert (prior >= 0).all()


def test_a_bone_by_hand(rest_joints: torch.Tensor) -> None:
    """Two nodes, at the middle of the left forearm and 6 cm along it, 5 cm beside it."""
    elbow, wrist = rest_joints[18], rest_joints[20]
    along = (wrist - elbow) / (wrist - elbow).norm()
    across = torch.linalg.cross(along, torch.tensor([0.0, 0, 1], dtype=torch.float64))
    across = across / across.norm()
    middle = (elbow + wrist) / 2
    place = middle + 0.06 * along + 0.05 * across
    prior = bone_prior(rest_joints, torch.stack([place, place + 0.02]), (2, 2, 2))
    expected = math.exp(-((0.06 / 0.12) ** 2) - (0.05 / 0.06) ** 2)
    assert prior[18, 0, 0, 0].item() == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    "direction",
    [[0, -1, 0], [0, 1, 0], [1e-9, -1, 0], [1, 0, 0], [-1e-200, -1, 1e-200], [0.6, 0.0, -0.8]],
)
def test_any_direction_of_a_bone_is_as_good_as_another(
    rest_joints: torch.Tensor, direction: list[float]
) -> None:
    """A shin far from everything: all at its middle, the formula 5 cm beside it."""
    along = torch.tensor(direction, dtype=torch.float64)
    aside = torch.linalg.cross(along, torch.tensor([0.3, 0.2, 0.9], dtype=torch.float64))
    joints = rest_joints.clone()
    joints[4] = torch.tensor([50.0, 0, 0])
    joints[7] = joints[4] + 0.4 * along
    joints[10] = joints[7] + torch.tensor([0.0, 0, 30.0])
    middle = (joints[4] + joints[7]) / 2
    end = middle + 0.05 * aside / aside.norm()
    prior = bone_prior(joints, torch.stack([middle, end]), (2, 2, 2))
    assert torch.isfinite(prior).all()
    assert prior[4, 0, 0, 0].item() == pytest.approx(1.0, abs=1e-6)
    assert prior[4, 1, 1, 1].item() == pytest.approx(math.exp(-((0.05 / 0.06) ** 2)), rel=1e-6)


@pytest.mark.parametrize(("joint", "child"), BONES)
def test_the_trunk_is_wider_than_the_limbs(
    rest_joints: torch.Tensor, joint: int, child: int
) -> None:
    """Each bone far from everything, 5 cm beside its middle: 3 cm, pelvis to collars 4.5."""
    joints = rest_joints.clone()
    joints[joint] = torch.tensor([50.0, 0, 0])
    joints[child] = torch.tensor([52.0, 0, 0])
    beside = torch.tensor([51.0, 0.03, 0.04], dtype=torch.float64)
    prior = bone_prior(joints, torch.stack([beside, beside + 0.02]), (2, 2, 2))
    sigma = 0.045 if joint in (0, 3, 6, 9, 13, 14) else 0.03
    expected = math.exp(-((0.05 / (2 * sigma)) ** 2))
    assert prior[joint, 0, 0, 0].item() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("leaf", sorted(set(range(24)) - set(PARENTS)))
def test_the_head_is_larger_than_hands_and_toes(rest_joints: torch.Tensor, leaf: int) -> None:
    """Each leaf far from everything, 5 cm beside it: 6 cm for the head, 2 for the others."""
    joints = rest_joints.clone()
    joints[leaf] = torch.tensor([50.0, 0, 0])
    beside = torch.tensor([50.0, 0.03, 0.04], dtype=torch.float64)
    prior = bone_prior(joints, torch.stack([beside, beside + 0.02]), (2, 2, 2))
    expected = math.exp(-((0.05 / (0.12 if leaf == 15 else 0.04)) ** 2))
    assert prior[leaf, 0, 0, 0].item() == pytest.approx(expected, rel=1e-6)


def test_a_bone_without_length_and_a_body_without_size(rest_joints: torch.Tensor) -> None:
    joints = rest_joints.clone()
    joints[20] = joints[18]
    assert torch.isfinite(log_prior(joints, canonical_box(joints), SIZES)).all()
    point = torch.zeros(24, 3, dtype=torch.float64)
    assert torch.isfinite(log_prior(point, canonical_box(point), (4, 4, 4))).all()


def test_the_logarithm_has_a_floor(rest_joints: torch.Tensor) -> None:
    prior = log_prior(rest_joints, canonical_box(rest_joints), SIZES)
    assert torch.isfinite(prior).all()
    assert prior.min().item() == pytest.approx(math.log(PRIOR_FLOOR))
    single = log_prior(rest_joints.float(), canonical_box(rest_joints.float()), SIZES)
    assert torch.isfinite(single).all()


@pytest.mark.parametrize("nodes", [8, 12, 16, 32])
@pytest.mark.parametrize("phase", [0.0, 0.25, 0.5, 0.75])
def test_hands_never_fall_between_the_nodes(
    rest_joints: torch.Tensor, nodes: int, phase: float
) -> None:
    """Whatever the grid's phase, a hand's own weight is well above the threshold 0.01."""
    box = canonical_box(rest_joints)
    shift = phase * (box[1] - box[0]) / (nodes - 1)
    prior = bone_prior(rest_joints, box + shift, (nodes, nodes, nodes))
    for hand in (22, 23):
        assert prior[hand].amax() > 0.05


def test_left_and_right_mirror_each_other(rest_joints: torch.Tensor) -> None:
    prior = bone_prior(rest_joints, canonical_box(rest_joints), SIZES)
    for left, right in ((1, 2), (4, 5), (7, 8), (10, 11), (13, 14), (16, 17), (20, 21), (22, 23)):
        torch.testing.assert_close(prior[left], prior[right].flip(2), rtol=0, atol=1e-12)


def test_nodes_lie_on_the_faces() -> None:
    box = torch.tensor([[0.0, 1.0, 2.0], [4.0, 3.0, 8.0]])
    nodes = grid_nodes(box, (3, 2, 5))
    assert nodes.shape == (3, 2, 5, 3)
    assert nodes[0, 0, 0].tolist() == [0, 1, 2] and nodes[2, 1, 4].tolist() == [4, 3, 8]
    assert nodes[1, 1, 3].tolist() == [3, 3, 5]


def test_autocast_leaves_the_prior_alone(rest_joints: torch.Tensor) -> None:
    joints = rest_joints.float()
    with torch.autocast("cpu", torch.bfloat16):
        inside = bone_prior(joints, canonical_box(joints), (8, 8, 8))
    outside = bone_prior(joints, canonical_box(joints), (8, 8, 8))
    torch.testing.assert_close(inside, outside, rtol=0, atol=0)
