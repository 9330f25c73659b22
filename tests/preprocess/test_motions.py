import numpy as np
import pytest

from actorsnerf_datasets.body_model import rest
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.skeleton import posed_joints
from actorsnerf_datasets.types import Float64, Role
from actorsnerf_preprocess.free_body import free_body
from actorsnerf_preprocess.motions import (
    DANCES,
    JOINT_HEIGHTS,
    SWINGS,
    Dance,
    Motion,
    draw_motion,
    turning_yaw,
)

FPS = 15.0


@pytest.fixture(scope="module")
def rest_joints() -> Float64:
    return rest(free_body(), np.zeros(10))[0]


def danced(dance: Dance, joints: Float64, frames: int = 60, seed: int = 4) -> Motion:
    return draw_motion(np.random.default_rng(seed), dance, np.zeros(frames), joints, FPS)


def world_joints(motion: Motion, joints: Float64) -> Float64:
    turned = matrix_from_axis_angle(motion.global_orient)
    return np.stack(
        [
            (posed_joints(pose, joints) - joints[0]) @ rotation.T + joints[0] + place
            for pose, rotation, place in zip(motion.poses, turned, motion.transl, strict=True)
        ]
    )


def test_no_held_out_dance_is_a_training_dance() -> None:
    assert not set(DANCES["pretraining"]) & set(DANCES["held_out"])
    assert set(SWINGS) == {*DANCES["pretraining"], *DANCES["held_out"]}


@pytest.mark.parametrize("dance", SWINGS)
def test_a_dance_is_smooth_and_stays_on_the_floor(dance: Dance, rest_joints: Float64) -> None:
    motion = danced(dance, rest_joints)
    assert motion.frame_count == 60
    assert not motion.poses[:, 0].any()
    assert np.abs(np.diff(motion.poses, axis=0)).max() < 0.5
    assert np.abs(motion.poses).max() < 2.1
    joints = world_joints(motion, rest_joints)
    feet = joints[:, list(JOINT_HEIGHTS), 1] - np.array(list(JOINT_HEIGHTS.values()))
    np.testing.assert_allclose(feet.min(axis=1), 0.0, atol=1e-9)
    assert np.abs(joints[:, 0, [0, 2]]).max() < 0.6
    assert np.linalg.norm(np.diff(joints, axis=0), axis=-1).max() < 0.6


def test_the_seed_decides_the_dance(rest_joints: Float64) -> None:
    first, again = danced("step", rest_joints), danced("step", rest_joints)
    np.testing.assert_array_equal(first.poses, again.poses)
    np.testing.assert_array_equal(first.transl, again.transl)
    assert np.abs(danced("step", rest_joints, seed=5).poses - first.poses).max() > 0.1


def test_yaw_turns_the_dancer_about_the_vertical(rest_joints: Float64) -> None:
    rng = np.random.default_rng(1)
    motion = draw_motion(rng, "sway", np.linspace(0, np.pi, 20), rest_joints, FPS)
    forward = matrix_from_axis_angle(motion.global_orient) @ [0.0, 0.0, 1.0]
    assert forward[0, 2] > 0.95
    assert forward[-1, 2] < -0.95
    assert np.abs(forward[:, 1]).max() < 0.2


@pytest.mark.parametrize(("frames", "pool"), [(100, 60), (560, 300)])
def test_a_held_out_dancer_shows_the_front_first_and_all_sides_within_the_pool(
    frames: int, pool: int
) -> None:
    yaw = turning_yaw(np.random.default_rng(0), "held_out", frames, pool)
    assert np.abs(yaw[: pool // 3]).max() < 0.2
    assert np.ptp(yaw[:pool]) > 1.9 * np.pi
    assert np.abs(np.diff(yaw)).max() < 0.3


@pytest.mark.parametrize("role", ["pretraining", "held_out"])
@pytest.mark.parametrize("frames", [1, 3, 24])
def test_short_videos_have_finite_turns(role: Role, frames: int) -> None:
    yaw = turning_yaw(np.random.default_rng(0), role, frames, int(0.6 * frames))
    assert yaw.shape == (frames,)
    assert np.isfinite(yaw).all()


def test_a_training_dancer_turns_right_round() -> None:
    yaw = turning_yaw(np.random.default_rng(0), "pretraining", 120, 72)
    assert np.ptp(yaw) > 1.8 * np.pi
