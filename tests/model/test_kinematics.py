import numpy as np
import torch
from torch.autograd import gradcheck

from actorsnerf_datasets import skeleton
from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames


def random_pose(generator: torch.Generator) -> torch.Tensor:
    pose = torch.randn(24, 3, generator=generator, dtype=torch.float64)
    pose[0] = 0
    return pose


def apply(motions: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    return (motions[..., :3, :3] @ points[..., None])[..., 0] + motions[..., :3, 3]


def test_at_rest_nothing_moves(rest_joints: torch.Tensor) -> None:
    there, back = bone_motions(torch.zeros(24, 3, dtype=torch.float64), rest_joints, rest_joints)
    identity = torch.eye(4, dtype=torch.float64).expand(24, 4, 4)
    torch.testing.assert_close(there, identity, rtol=0, atol=1e-15)
    torch.testing.assert_close(back, identity, rtol=0, atol=1e-15)


def test_a_bent_elbow_by_hand(rest_joints: torch.Tensor) -> None:
    pose = torch.zeros(24, 3, dtype=torch.float64)
    pose[18, 2] = torch.pi / 2  # left elbow: the forearm turns from +x to +y
    _, places = posed_frames(pose, rest_joints)
    forearm = rest_joints[20] - rest_joints[18]
    expected = rest_joints[18] + torch.stack([-forearm[1], forearm[0], forearm[2]])
    torch.testing.assert_close(places[20], expected, rtol=0, atol=1e-12)
    torch.testing.assert_close(places[19], rest_joints[19], rtol=0, atol=1e-15)


def test_equals_the_numpy_twin(generator: torch.Generator, rest_joints: torch.Tensor) -> None:
    pose = random_pose(generator)
    _, body_from_canonical = bone_motions(pose, rest_joints, rest_joints)
    twin = skeleton.joint_transforms(pose.numpy(), rest_joints.numpy())
    np.testing.assert_allclose(body_from_canonical.numpy(), twin, rtol=0, atol=1e-13)


def test_the_two_motions_are_inverse(generator: torch.Generator, rest_joints: torch.Tensor) -> None:
    there, back = bone_motions(random_pose(generator), rest_joints, 1.1 * rest_joints)
    identity = torch.eye(4, dtype=torch.float64).expand(24, 4, 4)
    torch.testing.assert_close(there @ back, identity, rtol=0, atol=1e-13)


def test_a_joint_goes_to_its_canonical_place(
    generator: torch.Generator, rest_joints: torch.Tensor
) -> None:
    pose, canonical = random_pose(generator), 1.1 * rest_joints + 0.02
    there, _ = bone_motions(pose, rest_joints, canonical)
    _, places = posed_frames(pose, rest_joints)
    torch.testing.assert_close(apply(there, places), canonical, rtol=0, atol=1e-13)


def test_many_poses_at_once(generator: torch.Generator, rest_joints: torch.Tensor) -> None:
    poses = torch.stack([random_pose(generator) for _ in range(3)])
    joints = rest_joints * torch.tensor([1.0, 0.9, 1.2], dtype=torch.float64)[:, None, None]
    there, back = bone_motions(poses, joints, rest_joints)
    for each in range(3):
        alone = bone_motions(poses[each], joints[each], rest_joints)
        torch.testing.assert_close((there[each], back[each]), alone, rtol=0, atol=1e-14)


def test_gradient(generator: torch.Generator, rest_joints: torch.Tensor) -> None:
    pose = random_pose(generator).requires_grad_()
    assert gradcheck(lambda given: bone_motions(given, rest_joints, rest_joints), (pose,))


def test_bounds_reach_thirty_centimetres_beyond_the_joints(rest_joints: torch.Tensor) -> None:
    bounds = observation_bounds(rest_joints)
    expected = torch.tensor([[-1.06, -1.46, -0.36], [1.06, 0.68, 0.39]], dtype=torch.float64)
    torch.testing.assert_close(bounds, expected, rtol=0, atol=1e-12)


def test_autocast_leaves_the_bones_alone(
    generator: torch.Generator, rest_joints: torch.Tensor
) -> None:
    pose, joints = random_pose(generator).float(), rest_joints.float()
    with torch.autocast("cpu", torch.bfloat16):
        inside = bone_motions(pose, joints, joints)
    torch.testing.assert_close(inside, bone_motions(pose, joints, joints), rtol=0, atol=0)
