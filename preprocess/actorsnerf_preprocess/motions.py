"""Seeded dances: smooth poses of the 24 joints and a path over the floor.

World: y up, the floor at y = 0, metres; at yaw 0 the dancer faces +z. All angles are radians.
Each joint swings by a few sines of seeded phase inside limits a body can reach; the lowest joint
stays on the floor.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from actorsnerf_datasets.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from actorsnerf_datasets.skeleton import posed_joints
from actorsnerf_datasets.types import Float64, Role

Dance = Literal["sway", "step", "twist", "lunge", "kick"]
DANCES: dict[Role, tuple[Dance, ...]] = {
    "pretraining": ("sway", "step", "twist"),
    "held_out": ("lunge", "kick"),
}
JOINT_HEIGHTS = {4: 0.06, 5: 0.06, 7: 0.07, 8: 0.07, 10: 0.026, 11: 0.026, 20: 0.05, 21: 0.05}
"""Joints that may touch the floor, and how far their skin reaches below them, metres."""
SHY_YAW = 0.04
"""How far a held-out dancer turns from the camera while it is still to be surprising."""
WANDER = 0.25
"""Radius of the path over the floor, metres."""


@dataclass(frozen=True)
class Motion:
    """A dance in the standard SMPL convention, y-up world."""

    poses: Float64
    """(F, 24, 3) axis-angle; the root is zero."""
    global_orient: Float64
    """(F, 3) axis-angle about the pelvis."""
    transl: Float64
    """(F, 3) metres."""
    frames_per_second: float

    @property
    def frame_count(self) -> int:
        """How many frames."""
        return len(self.poses)


@dataclass(frozen=True)
class Swings:
    """Largest angles of one dance, and its tempo."""

    tempo: float
    """Beats per second."""
    crouch: float
    legs: float
    """Stepping: hips forward and back."""
    spread: float
    """Legs to the side."""
    kick: float
    """One leg forward at a time."""
    arms_up: float
    arms_forward: float
    elbows: float
    twist: float
    sway: float


SWINGS: dict[Dance, Swings] = {
    "sway": Swings(0.55, 0.35, 0.15, 0.18, 0.0, 1.0, 0.35, 0.9, 0.25, 0.35),
    "step": Swings(0.80, 0.45, 0.50, 0.10, 0.0, 0.5, 0.60, 1.2, 0.20, 0.12),
    "twist": Swings(0.65, 0.55, 0.20, 0.15, 0.0, 0.7, 0.45, 1.1, 0.55, 0.20),
    "lunge": Swings(0.50, 0.80, 0.35, 0.35, 0.0, 1.4, 0.30, 0.6, 0.12, 0.18),
    "kick": Swings(0.60, 0.30, 0.15, 0.12, 1.0, 1.1, 0.70, 0.8, 0.15, 0.15),
}


def draw_motion(
    rng: np.random.Generator, dance: Dance, yaw: Float64, rest_joints: Float64, fps: float
) -> Motion:
    """A dance of len(yaw) frames that turns as `yaw` (F,) says, for a body with these joints."""
    swings = SWINGS[dance]
    seconds = np.arange(len(yaw)) / fps
    poses = np.zeros((len(yaw), 24, 3))
    _move_legs(poses, swings, _Waves(rng, seconds, swings.tempo))
    _move_trunk(poses, swings, _Waves(rng, seconds, swings.tempo))
    _move_arms(poses, swings, _Waves(rng, seconds, swings.tempo))
    tilt = _Waves(rng, seconds, swings.tempo / 2)
    about_y = np.zeros((len(yaw), 3))
    about_y[:, 1] = yaw
    lean = np.stack([0.06 * tilt.wave(), np.zeros(len(yaw)), 0.05 * tilt.wave()], axis=1)
    orient = matrix_from_axis_angle(about_y) @ matrix_from_axis_angle(lean)
    path = WANDER * np.stack([tilt.wave(0.3), np.zeros(len(yaw)), tilt.wave(0.3)], axis=1)
    path[:, 1] = -_lowest(poses, orient, rest_joints)
    pelvis = rest_joints[0]
    transl = path - pelvis * [1.0, 0.0, 1.0]
    return Motion(poses, axis_angle_from_matrix(orient), transl, fps)


def turning_yaw(rng: np.random.Generator, role: Role, frames: int, pool: int) -> Float64:
    """(F,) yaw: who is held out faces the camera for a third of the pool, then turns right round.

    Pre-training dancers turn from the start, about once in every 120 frames or once in all.
    """
    position = np.arange(frames, dtype=np.float64)
    wobble = 0.12 * np.sin(position / max(frames, 40) * 14 + rng.uniform(0, 2 * np.pi))
    if role == "pretraining":
        direction = rng.choice([-1.0, 1.0])
        turn = 2 * np.pi * position / min(120.0, max(frames * 0.9, 1.0))
        yaw: Float64 = rng.uniform(0, 2 * np.pi) + direction * turn + wobble
        return yaw
    start, end = pool / 3 + 1, max(pool - 2.0, pool / 3 + 2)
    part = np.clip((position - start) / (end - start), 0.0, None)
    turned: Float64 = 2 * np.pi * part + SHY_YAW * np.sin(position / max(start, 1) * 4)
    return turned


class _Waves:
    """Smooth seeded signals in [-1, 1] over the frames of one dance."""

    def __init__(self, rng: np.random.Generator, seconds: Float64, tempo: float) -> None:
        self._rng = rng
        self._seconds = seconds
        self._tempo = tempo

    def wave(self, slower: float = 1.0) -> Float64:
        """(F,) two sines, one per beat and one slower and stronger or weaker."""
        phases = self._rng.uniform(0, 2 * np.pi, 2)
        share = self._rng.uniform(0.35, 0.65)
        beat = 2 * np.pi * self._tempo * slower * self._seconds
        signal: Float64 = share * np.sin(beat + phases[0])
        signal += (1 - share) * np.sin(beat * 0.618 + phases[1])
        return signal

    def bump(self, slower: float = 1.0) -> Float64:
        """(F,) in [0, 1], smooth, near 0 half of the time."""
        positive: Float64 = np.clip(self.wave(slower), 0.0, None)
        return positive**2 * (3 - 2 * positive)


def _move_legs(poses: Float64, swings: Swings, waves: _Waves) -> None:
    """Hips, knees, ankles; soles stay roughly level."""
    crouch = swings.crouch * (0.5 + 0.5 * waves.wave())
    step, spread = waves.wave(), swings.spread * (0.6 + 0.4 * waves.wave(0.5))
    for hip, knee, ankle, side in ((1, 4, 7, 1.0), (2, 5, 8, -1.0)):
        kick = swings.kick * waves.bump(0.7)
        forward = -crouch - swings.legs * side * step - kick
        bend = 2 * crouch + swings.legs * np.clip(side * step + 0.2, 0.0, None) + 0.05
        poses[:, hip, 0] = np.clip(forward, -1.7, 0.5)
        poses[:, hip, 1] = 0.1 * side * waves.wave()
        poses[:, hip, 2] = side * spread
        poses[:, knee, 0] = np.clip(bend + 0.4 * kick * waves.bump(), 0.0, 2.0)
        level = -(poses[:, hip, 0] + poses[:, knee, 0])
        poses[:, ankle, 0] = np.clip(level, -0.5, 0.5)
        poses[:, ankle, 2] = -0.6 * side * spread


def _move_trunk(poses: Float64, swings: Swings, waves: _Waves) -> None:
    """Spine, neck and head."""
    twist, sway, bow = waves.wave(), waves.wave(), waves.wave(0.5)
    for joint in (3, 6, 9):
        poses[:, joint, 0] = 0.05 + 0.07 * bow
        poses[:, joint, 1] = swings.twist / 3 * twist
        poses[:, joint, 2] = swings.sway / 3 * sway
    for joint in (12, 15):
        poses[:, joint, 0] = -0.04 + 0.10 * waves.wave()
        poses[:, joint, 1] = 0.20 * waves.wave(0.6)
        poses[:, joint, 2] = 0.08 * waves.wave()


def _move_arms(poses: Float64, swings: Swings, waves: _Waves) -> None:
    """Collars, shoulders, elbows, wrists; arms hang at -1.15 and rise from there."""
    for collar, shoulder, elbow, wrist, side in ((13, 16, 18, 20, 1.0), (14, 17, 19, 21, -1.0)):
        raised = swings.arms_up * (0.5 + 0.6 * waves.wave())
        lift = np.clip(-1.15 + raised, -1.2, 0.9)
        forward = swings.arms_forward * (0.3 + 0.7 * waves.wave())
        flex = swings.elbows * (0.5 + 0.5 * waves.wave())
        poses[:, collar, 2] = side * 0.15 * np.clip(lift, 0.0, None)
        poses[:, shoulder, 0] = 0.25 * waves.wave()
        poses[:, shoulder, 1] = -side * np.clip(forward, -0.4, 0.9)
        poses[:, shoulder, 2] = side * lift
        poses[:, elbow, 1] = -side * np.clip(flex, 0.08, 2.0)
        poses[:, wrist, 2] = side * 0.2 * waves.wave()
        poses[:, wrist, 1] = 0.2 * waves.wave()


def _lowest(poses: Float64, orient: Float64, rest_joints: Float64) -> Float64:
    """(F,) height of the lowest skin when the pelvis stays where it rests."""
    heights = []
    touching = list(JOINT_HEIGHTS)
    reach = np.array(list(JOINT_HEIGHTS.values()))
    for pose, rotation in zip(poses, orient, strict=True):
        joints = posed_joints(pose, rest_joints)
        world = (joints - rest_joints[0]) @ rotation.T + rest_joints[0]
        heights.append((world[touching, 1] - reach).min())
    return np.array(heights)
