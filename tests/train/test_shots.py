import dataclasses
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest

from actorsnerf_datasets.cameras import camera_from_world
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.skeleton import posed_joints
from actorsnerf_datasets.types import Float64
from actorsnerf_train.pose_file import PoseSequence
from actorsnerf_train.shots import (
    Shot,
    Turn,
    chosen_frames,
    file_shots,
    foreign_shots,
    own_shots,
    turntable_shots,
)

REST = np.random.default_rng(4).normal(size=(24, 3)) * 0.3
POSE = np.concatenate([np.zeros((1, 3)), np.random.default_rng(5).normal(size=(23, 3)) * 0.3])


class People(Protocol):
    eve: Path


@pytest.fixture
def file(people: People) -> SequenceFile:
    return SequenceFile(people.eve)


def joints_in_camera(shot: Shot) -> Float64:
    matrix = shot.camera.camera_from_body.numpy().astype(np.float64)
    seen: Float64 = posed_joints(shot.pose, shot.rest_joints) @ matrix[:3, :3].T + matrix[:3, 3]
    return seen


def joints_in_picture(shot: Shot) -> Float64:
    seen = joints_in_camera(shot) @ shot.camera.K.numpy().T.astype(np.float64)
    pixels: Float64 = seen[:, :2] / seen[:, 2:]
    return pixels


def test_a_turntable_goes_round_once_at_one_distance() -> None:
    shots = turntable_shots(POSE, REST, Turn(pictures=4, size=64, elevation=10.0))
    assert len(shots) == 4
    places = []
    for shot in shots:
        matrix = shot.camera.camera_from_body.numpy()
        places.append(-matrix[:3, :3].T @ matrix[:3, 3])
        assert shot.camera.size == (64, 64)
        assert joints_in_picture(shot).min() > 0 and joints_in_picture(shot).max() < 63
    joints = posed_joints(POSE, REST)
    middle = (joints.min(axis=0) + joints.max(axis=0)) / 2
    distances = np.linalg.norm(np.stack(places) - middle, axis=1)
    assert np.allclose(distances, distances[0], rtol=1e-5)
    assert places[0][2] > places[2][2]  # begins in front: the body looks along +z
    assert np.allclose((places[0] + places[2]) / 2, (places[1] + places[3]) / 2, atol=1e-5)


def test_own_frames_look_through_the_files_camera(file: SequenceFile) -> None:
    shots = own_shots(file, "camera1", [3, 7])
    fits, camera = file.header.fits, file.header.cameras[1]
    world = fits.posed_joints[7] @ fits.world_from_body[7, :3, :3].T
    world = world + fits.world_from_body[7, :3, 3]
    assert np.allclose(joints_in_camera(shots[1]), world @ camera.R.T + camera.T, atol=1e-5)
    assert shots[1].camera.size == camera.size
    assert np.allclose(shots[1].camera.K.numpy(), camera.K)


def test_foreign_frames_of_the_actors_own_body_are_its_own(file: SequenceFile) -> None:
    own = own_shots(file, 1, [5])[0]
    same = foreign_shots(file, 1, [5], file.header.fits.rest_joints[5])[0]
    assert np.allclose(joints_in_camera(own), joints_in_camera(same), atol=1e-6)


def test_a_foreign_motion_puts_the_pelvis_where_the_others_was(file: SequenceFile) -> None:
    shot = foreign_shots(file, "camera0", [4], REST)[0]
    fits, camera = file.header.fits, file.header.cameras[0]
    world_from_body = fits.world_from_body[4]
    pelvis = camera_from_world(camera.R, camera.T) @ world_from_body
    expected = pelvis @ np.append(fits.posed_joints[4, 0], 1.0)
    assert np.allclose(joints_in_camera(shot)[0], expected[:3], atol=1e-5)
    assert np.array_equal(shot.rest_joints, REST)
    turned = camera.R @ world_from_body[:3, :3]
    assert np.allclose(shot.camera.camera_from_body[:3, :3].numpy(), turned, atol=1e-6)


@pytest.fixture
def poses(rng: np.random.Generator) -> PoseSequence:
    return PoseSequence(
        global_orient=rng.normal(size=(6, 3)) * 0.4,
        body_pose=rng.normal(size=(6, 23, 3)) * 0.3,
        transl=rng.normal(size=(6, 3)) * 10,
        up=np.array([0.0, 1.0, 0.0]),
        fps=30.0,
    )


def test_a_motion_file_is_danced_on_the_spot_inside_the_picture(poses: PoseSequence) -> None:
    shots = file_shots(poses, [0, 2, 4], REST, Turn(size=80))
    pelvis = np.stack([joints_in_camera(shot)[0] for shot in shots])
    assert np.allclose(pelvis, pelvis[0], atol=1e-5)
    for shot in shots:
        pixels = joints_in_picture(shot)
        assert pixels.min() > 0 and pixels.max() < 79


def test_root_rotations_turn_the_body_before_a_still_camera(poses: PoseSequence) -> None:
    shots = file_shots(poses, [1, 3], REST, Turn(size=80))
    rotations = matrix_from_axis_angle(poses.global_orient)
    views = [shot.camera.camera_from_body[:3, :3].numpy() for shot in shots]
    assert np.allclose(views[0] @ rotations[1].T, views[1] @ rotations[3].T, atol=1e-5)


def test_the_camera_faces_the_first_pose(poses: PoseSequence) -> None:
    upright = dataclasses.replace(poses, global_orient=np.array([[0.0, 1.2, 0.0]] * 6))
    matrix = file_shots(upright, [0], REST, Turn(size=80))[0].camera.camera_from_body.numpy()
    assert np.allclose(matrix[:3, :3] @ [0, 0, 1], [0, 0, -1], atol=1e-5)  # towards the camera
    assert np.allclose(matrix[:3, :3] @ [0, 1, 0], [0, -1, 0], atol=1e-5)


@pytest.mark.parametrize(
    ("choice", "frames"), [((0, 1, 3), [0, 1, 2]), ((2, 3, 9), [2, 5, 8]), ((9, 1, 9), [9])]
)
def test_chosen_frames(choice: tuple[int, int, int], frames: list[int]) -> None:
    assert chosen_frames(10, *choice) == frames


@pytest.mark.parametrize("choice", [(10, 1, 5), (-1, 1, 5), (0, 0, 5), (0, 1, 0)])
def test_no_frame_left_is_a_sentence(choice: tuple[int, int, int]) -> None:
    with pytest.raises(UserError, match="No frame is left of 10 with --first"):
        chosen_frames(10, *choice)
