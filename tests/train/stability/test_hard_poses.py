import math

import torch

from actorsnerf_model.rotations import matrix_from_axis_angle
from actorsnerf_train.stability.hard_poses import (
    SPREAD,
    dance_poses,
    fastest,
    named_poses,
    wound_up,
)


def test_the_root_stands_still() -> None:
    assert all(not bool(pose[0].any()) for pose in named_poses().values())
    assert not bool(dance_poses(20, torch.Generator().manual_seed(0))[:, 0].any())


def test_left_and_right_are_mirrored_where_the_pose_is_even() -> None:
    pose = named_poses()["hands clasped"]
    mirror = torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
    torch.testing.assert_close(pose[16] * mirror, pose[17])
    torch.testing.assert_close(pose[18] * mirror, pose[19])


def test_dancers_spread_as_the_table_says() -> None:
    poses = dance_poses(4000, torch.Generator().manual_seed(0))
    calm = poses[torch.arange(4000) % 10 != 9]
    assert abs(float(calm[:, 18].std()) - SPREAD["elbow"]) < 0.02
    wild = poses[9::10]
    assert abs(float(wild[:, 18].std()) - 2 * SPREAD["elbow"]) < 0.1


def test_a_turn_more_is_the_same_pose() -> None:
    pose = named_poses()["crouching"]
    wound = wound_up(pose)
    assert float((wound.norm(dim=-1) - pose.norm(dim=-1)).max()) > 2 * math.pi - 1e-9
    torch.testing.assert_close(
        matrix_from_axis_angle(wound), matrix_from_axis_angle(pose), rtol=0, atol=1e-12
    )


def test_the_fastest_frames_come_first() -> None:
    poses = torch.zeros(5, 24, 3)
    poses[2:, 4] = 0.5
    poses[4, 5] = 2.0
    assert fastest(poses, 2) == [4, 2]
    assert fastest(poses[:2], 3) == [1]
