import numpy as np

from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.skeleton import (
    BONES,
    JOINT_NAMES,
    PARENTS,
    joint_transforms,
    posed_joints,
)
from actorsnerf_datasets.types import Float64


def _homogeneous(rotation: Float64, translation: Float64) -> Float64:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def _slow_transforms(axis_angles: Float64, rest: Float64) -> Float64:
    """A joint's motion: its parent's, after a turn about the joint's own rest position."""
    motions: list[Float64] = []
    for joint, parent in enumerate(PARENTS):
        rotation = matrix_from_axis_angle(axis_angles[joint])
        about_joint = _homogeneous(rotation, rest[joint] - rotation @ rest[joint])
        motions.append(about_joint if parent < 0 else motions[parent] @ about_joint)
    return np.stack(motions)


def test_the_tree_is_smpls() -> None:
    assert len(JOINT_NAMES) == len(PARENTS) == 24
    assert all(parent < joint for joint, parent in enumerate(PARENTS))
    named = {JOINT_NAMES[joint]: JOINT_NAMES[parent] for parent, joint in BONES}
    assert named["left_hand"] == "left_wrist"
    assert named["head"] == "neck"
    assert named["right_collar"] == "spine3"
    assert named["left_knee"] == "left_hip"


def test_equals_turning_about_each_joint(rng: np.random.Generator) -> None:
    pose, rest = rng.normal(size=(24, 3)), rng.normal(size=(24, 3))
    expected = _slow_transforms(pose, rest)
    np.testing.assert_allclose(joint_transforms(pose, rest), expected, atol=1e-13)


def test_zero_pose_moves_nothing(rng: np.random.Generator) -> None:
    rest = rng.normal(size=(24, 3))
    identity = np.broadcast_to(np.eye(4), (24, 4, 4))
    np.testing.assert_allclose(joint_transforms(np.zeros((24, 3)), rest), identity, atol=1e-15)


def test_a_bent_elbow_moves_the_hand_by_hand() -> None:
    rest = np.zeros((24, 3))
    rest[18], rest[20], rest[22] = [1.0, 0, 0], [2.0, 0, 0], [2.5, 0, 0]
    pose = np.zeros((24, 3))
    pose[18] = [0.0, 0.0, np.pi / 2]
    joints = posed_joints(pose, rest)
    expected = np.array([[1, 0, 0], [1, 1, 0], [1, 1.5, 0]])
    np.testing.assert_allclose(joints[[18, 20, 22]], expected, atol=1e-15)


def test_bone_lengths_stay_and_the_pelvis_stays(rng: np.random.Generator) -> None:
    pose, rest = rng.normal(size=(5, 24, 3)), rng.normal(size=(5, 24, 3))
    joints = posed_joints(pose, rest)
    for parent, joint in BONES:
        before = np.linalg.norm(rest[:, joint] - rest[:, parent], axis=-1)
        after = np.linalg.norm(joints[:, joint] - joints[:, parent], axis=-1)
        np.testing.assert_allclose(after, before, atol=1e-13)
    np.testing.assert_allclose(joints[:, 0], rest[:, 0], atol=1e-15)


def test_one_skeleton_serves_many_poses(rng: np.random.Generator) -> None:
    poses, rest = rng.normal(size=(3, 24, 3)), rng.normal(size=(24, 3))
    expected = np.stack([posed_joints(pose, rest) for pose in poses])
    np.testing.assert_allclose(posed_joints(poses, rest), expected, atol=1e-14)
