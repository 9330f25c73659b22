"""The poses and cameras of a film: where each motion puts the actor, and who looks at it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from actorsnerf_datasets.cameras import camera_from_world
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.selection import camera_index
from actorsnerf_datasets.skeleton import posed_joints
from actorsnerf_datasets.types import Float64
from actorsnerf_model.states import Camera
from actorsnerf_train.orbit import orbit_camera, orbit_intrinsics, stage_of
from actorsnerf_train.pose_file import PoseSequence

BODY_UP = np.array([0.0, 1.0, 0.0])
"""Of SMPL's own frame."""
BODY_FRONT = np.array([0.0, 0.0, 1.0])
"""Where a person in SMPL's own frame looks."""


@dataclass(frozen=True)
class Shot:
    """One picture to take: a pose and a camera, both in the frame of the body."""

    pose: Float64
    """(24, 3) axis-angle, the root zero."""
    rest_joints: Float64
    """(24, 3) metres."""
    camera: Camera


@dataclass(frozen=True)
class Turn:
    """A camera's walk around the actor."""

    pictures: int = 24
    size: int = 512
    """Height and width, pixels."""
    elevation: float = 0.0
    """Degrees above the actor's middle."""


def turntable_shots(pose: Float64, rest_joints: Float64, turn: Turn) -> list[Shot]:
    """One pose (24, 3) from all around, beginning in front."""
    stage = stage_of(posed_joints(pose, rest_joints), BODY_UP, BODY_FRONT)
    angles = [360.0 * i / turn.pictures for i in range(turn.pictures)]
    return [
        Shot(
            pose,
            rest_joints,
            _camera(
                orbit_intrinsics(turn.size),
                orbit_camera(stage, angle, turn.elevation),
                (turn.size, turn.size),
            ),
        )
        for angle in angles
    ]


def own_shots(file: SequenceFile, camera: str | int, frames: Sequence[int]) -> list[Shot]:
    """The actor's own frames (positions) from a camera of its own file."""
    index = camera_index(file, camera)
    known, fits = file.header.cameras[index], file.header.fits
    return [
        Shot(
            _rootless(fits.body_pose[frame]),
            fits.rest_joints[frame],
            _camera(known.K, file.camera_from_body(index, frame), known.size),
        )
        for frame in frames
    ]


def foreign_shots(
    file: SequenceFile, camera: str | int, frames: Sequence[int], rest_joints: Float64
) -> list[Shot]:
    """Another actor's frames (positions) and camera; the pelvis goes where the other's was.

    Args:
        file: the other actor's.
        camera: of that file, by name or position.
        frames: positions in that file.
        rest_joints: (24, 3) of the actor that is rendered.
    """
    index = camera_index(file, camera)
    known, fits = file.header.cameras[index], file.header.fits
    into_camera = camera_from_world(known.R, known.T)
    shots = []
    for frame in frames:
        rotation = fits.world_from_body[frame, :3, :3]
        other_pelvis = fits.world_from_body[frame] @ np.append(fits.rest_joints[frame, 0], 1.0)
        world_from_body = _placed(rotation, other_pelvis[:3], rest_joints[0])
        shots.append(
            Shot(
                _rootless(fits.body_pose[frame]),
                rest_joints,
                _camera(known.K, into_camera @ world_from_body, known.size),
            )
        )
    return shots


def file_shots(
    poses: PoseSequence, frames: Sequence[int], rest_joints: Float64, turn: Turn
) -> list[Shot]:
    """Frames (positions) of a motion file, danced on the spot before a camera that stands still.

    The camera faces the first pose; every pose of the film fits its picture.
    """
    if not frames:
        return []
    rotations = matrix_from_axis_angle(poses.global_orient)
    placed = {f: _placed(rotations[f], np.zeros(3), rest_joints[0]) for f in frames}
    joints = np.stack(
        [
            posed_joints(_rootless(poses.body_pose[f]), rest_joints) @ placed[f][:3, :3].T
            + placed[f][:3, 3]
            for f in frames
        ]
    )
    stage = stage_of(joints, poses.up, rotations[frames[0]] @ BODY_FRONT)
    into_camera = orbit_camera(stage, 0.0, turn.elevation)
    K, size = orbit_intrinsics(turn.size), (turn.size, turn.size)
    return [
        Shot(_rootless(poses.body_pose[f]), rest_joints, _camera(K, into_camera @ placed[f], size))
        for f in frames
    ]


def chosen_frames(count: int, first: int, step: int, most: int) -> list[int]:
    """Positions `first`, `first + step`, ... below `count`, at most so many.

    Raises:
        UserError: there are none.
    """
    frames = list(range(first, count, step))[:most] if first >= 0 and step > 0 else []
    if not frames:
        raise UserError(
            f"No frame is left of {count} with --first {first}, --step {step} and --pictures "
            f"{most}: choose a first below {count}, and a step and a number above 0."
        )
    return frames


def _placed(rotation: Float64, pelvis: Float64, own_pelvis: Float64) -> Float64:
    """The rigid transform (4, 4) that turns a body and puts its pelvis somewhere."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = pelvis - rotation @ own_pelvis
    return matrix


def _rootless(body_pose: Float64) -> Float64:
    return np.concatenate([np.zeros((1, 3)), body_pose])


def _camera(K: Float64, camera_from_body: Float64, size: tuple[int, int]) -> Camera:
    return Camera(torch.from_numpy(K).float(), torch.from_numpy(camera_from_body).float(), size)
