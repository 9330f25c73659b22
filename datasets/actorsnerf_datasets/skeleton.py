"""The SMPL skeleton: joint names, parents, and the rigid motion of each bone in a pose."""

import numpy as np

from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.types import Float64

JOINT_NAMES: tuple[str, ...] = (
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
)
"""Left and right are the person's own."""

PARENTS: tuple[int, ...] = (
    *(-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8),
    *(9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21),
)
"""Parent of each joint; the root's is -1, and every parent comes before its children."""

BONES: tuple[tuple[int, int], ...] = tuple(
    (parent, joint) for joint, parent in enumerate(PARENTS) if parent >= 0
)
"""(parent, joint) pairs: the lines of a stick figure."""


def joint_transforms(axis_angles: Float64, rest_joints: Float64) -> Float64:
    """The rigid motion (..., 24, 4, 4) that carries a rest-pose point of bone b to the pose.

    `body_from_canonical[b] @ (x, 1)` is where a point x, rigidly attached to bone b at rest, lies
    in the pose. The root turns about the rest pelvis, which itself stays where it is.

    Args:
        axis_angles: (..., 24, 3) rotation of each joint relative to its parent, radians.
        rest_joints: (..., 24, 3) zero-pose joints, metres, same leading axes or broadcastable.

    Source: SMPL (Loper et al. 2015), eq. 3 and 4.
    """
    local = matrix_from_axis_angle(axis_angles)
    rest = np.broadcast_to(rest_joints, axis_angles.shape)
    rotations: list[Float64] = []
    positions: list[Float64] = []
    for joint, parent in enumerate(PARENTS):
        if parent < 0:
            rotations.append(local[..., joint, :, :])
            positions.append(rest[..., joint, :])
            continue
        offset = rest[..., joint, :] - rest[..., parent, :]
        rotations.append(rotations[parent] @ local[..., joint, :, :])
        positions.append(positions[parent] + (rotations[parent] @ offset[..., None])[..., 0])
    body_from_canonical = np.zeros((*axis_angles.shape[:-1], 4, 4))
    rotation = np.stack(rotations, axis=-3)
    body_from_canonical[..., :3, :3] = rotation
    moved = (rotation @ rest[..., None])[..., 0]
    body_from_canonical[..., :3, 3] = np.stack(positions, axis=-2) - moved
    body_from_canonical[..., 3, 3] = 1.0
    return body_from_canonical


def posed_joints(axis_angles: Float64, rest_joints: Float64) -> Float64:
    """Joint positions (..., 24, 3) in the pose, metres; arguments as for `joint_transforms`.

    >>> rest = np.zeros((24, 3)); rest[1:, 1] = 1.0
    >>> bend = np.zeros((24, 3)); bend[0] = [0.0, 0.0, np.pi]
    >>> posed_joints(bend, rest)[1].round(12).tolist()
    [-0.0, -1.0, 0.0]
    """
    transforms = joint_transforms(axis_angles, rest_joints)
    rest = np.broadcast_to(rest_joints, axis_angles.shape)
    moved: Float64 = (transforms[..., :3, :3] @ rest[..., None])[..., 0]
    return moved + transforms[..., :3, 3]
