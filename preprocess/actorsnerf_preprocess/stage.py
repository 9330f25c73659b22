"""The invented stage: who dances, where the cameras stand, and what each of them sees.

Shared by the writers of synthetic raw trees. World: y up, floor at y = 0, metres.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from actorsnerf_datasets.types import Float64, Role, UInt8
from actorsnerf_preprocess.actors import (
    DressedActor,
    draw_actor,
    draw_meshes,
    dress,
    frame_pose,
    open_studio,
)
from actorsnerf_preprocess.motions import DANCES, Motion, draw_motion, turning_yaw
from actorsnerf_preprocess.renderer import Light, Lighting, Mesh, MeshRenderer, Pinhole

LIGHTING = Lighting(
    (
        Light(np.array([-0.4, -1.0, -0.6]), 2.0),
        Light(np.array([0.7, -0.5, 0.8]), 1.2),
    ),
    0.35,
)
"""A key light, a fill light from behind, and what the room gives back."""
FINER = 2
"""Pictures are drawn with this many pixels per pixel and averaged, so that edges are soft."""
WIDER = 1.35
"""The undistorted canvas is this much larger than the picture, so that barrel distortion, which
sees more, finds everything drawn."""


@dataclass(frozen=True)
class SyntheticOptions:
    """How large a synthetic data set is."""

    actors: int = 8
    """Pre-training actors."""
    held_out: int = 2
    """Actors that pre-training must not see."""
    frames: int = 100
    cameras: int = 6
    size: int = 512
    """Pixels per side of the raw pictures."""
    seed: int = 0
    full: bool = False
    """Draw every camera of every frame, not only what the generic protocol uses."""


@dataclass(frozen=True)
class Performance:
    """One actor dancing."""

    dressed: DressedActor
    motion: Motion

    @property
    def name(self) -> str:
        """The actor's name."""
        return self.dressed.actor.name

    @property
    def role(self) -> Role:
        """Pre-training or held out."""
        return self.dressed.actor.role


@dataclass(frozen=True)
class Lens:
    """A real lens: the pinhole behind it and its distortion."""

    pinhole: Pinhole
    distortion: Float64
    """(5,) k1 k2 p1 p2 k3 (OpenCV)."""


@dataclass(frozen=True)
class Shot:
    """What one camera sees of the person."""

    rgb: UInt8
    """(H, W, 3) on black, distorted."""
    coverage: Float64
    """(H, W) the person's share of each pixel."""
    labels: UInt8
    """(H, W) part labels of the pixels that are at least half covered, 0 elsewhere."""


def performances(
    options: SyntheticOptions, renderer: MeshRenderer, frames_per_second: float
) -> Iterator[Performance]:
    """The actors one after the other, pre-training first; the seed decides all of them."""
    studio = open_studio()
    pool = min(300, int(0.6 * options.frames))
    roles: list[tuple[int, Role]] = [(index, "pretraining") for index in range(options.actors)]
    roles += [(index, "held_out") for index in range(options.held_out)]
    for index, role in roles:
        actor = draw_actor(options.seed, index, role)
        dressed = dress(studio, actor, renderer)
        rng = np.random.default_rng([options.seed, index, int(role == "held_out"), 1])
        yaw = turning_yaw(rng, role, options.frames, pool)
        rest_joints = studio.body.joint_regressor @ (
            studio.body.template + studio.body.shape_directions @ actor.betas
        )
        dances = DANCES[role]
        dance = dances[index % len(dances)]
        yield Performance(dressed, draw_motion(rng, dance, yaw, rest_joints, frames_per_second))


def ring(
    count: int, radius: float, height: float, focal: float, size: tuple[int, int]
) -> tuple[Pinhole, ...]:
    """Cameras on a circle round the dancer, the first in front, all looking at the waist.

    Args:
        count: cameras.
        radius: metres from the axis.
        height: metres above the floor; every second camera stands 0.25 m higher.
        focal: pixels; each camera's differs by up to one percent, like real lenses.
        size: width, height.
    """
    cameras = []
    for index in range(count):
        angle = 2 * np.pi * index / count
        centre = np.array(
            [radius * np.sin(angle), height + 0.25 * (index % 2), radius * np.cos(angle)]
        )
        forward = np.array([0.0, 0.9, 0.0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(forward, right), forward])
        scale = 1 + 0.01 * np.sin(3.0 * index)
        width, tall = size
        K = np.array(
            [
                [focal * scale, 0.0, width * (0.5 + 0.01 * np.sin(index))],
                [0.0, focal * (2 - scale), tall * (0.5 - 0.01 * np.cos(index))],
                [0.0, 0.0, 1.0],
            ]
        )
        cameras.append(Pinhole(K, R, -R @ centre, size))
    return tuple(cameras)


def take(renderer: MeshRenderer, meshes: list[Mesh], lens: Lens) -> Shot:
    """The picture that a real lens makes of the meshes, with soft edges."""
    wide = _wider(lens.pinhole).finer(FINER)
    drawing = renderer.draw(meshes, wide, LIGHTING)
    lookup = _lookup(lens, wide)
    size = lens.pinhole.size
    covered = (drawing.labels > 0).astype(np.float32)
    rgb = cv2.remap(drawing.rgb, *lookup, cv2.INTER_LINEAR)
    share = cv2.resize(
        cv2.remap(covered, *lookup, cv2.INTER_LINEAR), size, interpolation=cv2.INTER_AREA
    )
    labels = cv2.remap(drawing.labels, *lookup, cv2.INTER_NEAREST)[::FINER, ::FINER]
    labels = np.where(share >= 0.5, np.maximum(labels, 1), 0)
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    return Shot(small.astype(np.uint8), share.astype(np.float64), labels.astype(np.uint8))


def meshes_of(performance: Performance, frame: int) -> list[Mesh]:
    """The dressed actor in one frame."""
    return draw_meshes(
        performance.dressed, frame_pose(performance.dressed, performance.motion, frame)
    )


def _wider(pinhole: Pinhole) -> Pinhole:
    width, height = pinhole.size
    more_x, more_y = int(width * (WIDER - 1) / 2), int(height * (WIDER - 1) / 2)
    K = pinhole.K.copy()
    K[0, 2] += more_x
    K[1, 2] += more_y
    return Pinhole(K, pinhole.R, pinhole.T, (width + 2 * more_x, height + 2 * more_y))


def _lookup(lens: Lens, wide: Pinhole) -> tuple[UInt8, UInt8]:
    """Where each (finer) pixel of the distorted picture lies on the undistorted canvas."""
    fine = lens.pinhole.finer(FINER)
    width, height = fine.size
    x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    seen = np.stack([x.ravel(), y.ravel()], -1)[:, None]
    straight = cv2.undistortPoints(seen, fine.K, lens.distortion, P=wide.K)[:, 0]
    places = straight.reshape(height, width, 2).astype(np.float32)
    return places[..., 0], places[..., 1]
