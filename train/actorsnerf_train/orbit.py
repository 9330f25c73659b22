"""Cameras that walk around a body."""

import math
from dataclasses import dataclass

import numpy as np

from actorsnerf_datasets.types import Float64

FIELD_OF_VIEW = 30.0
"""Degrees from edge to edge of the square picture; a mild telephoto, as in the studios."""
MARGIN = 0.3
"""Metres of body and clothes around the joints that must fit the picture."""


@dataclass(frozen=True)
class Stage:
    """What the cameras look at, in the frame they stand in."""

    centre: Float64
    """(3,) metres."""
    radius: float
    """Of the sphere around the centre that must fit the picture, metres."""
    up: Float64
    """(3,) unit vector."""
    front: Float64
    """(3,) where the first camera stands, seen from the centre; made orthogonal to `up`."""


def stage_of(joints: Float64, up: Float64, front: Float64) -> Stage:
    """The stage that holds all joints (..., 3), e.g. those of every frame of a motion."""
    points = joints.reshape(-1, 3)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    reach = float(np.linalg.norm(points - centre, axis=1).max())
    return Stage(centre=centre, radius=reach + MARGIN, up=up, front=front)


def orbit_intrinsics(size: int) -> Float64:
    """Intrinsics (3, 3) of the square picture; its middle lies between the central pixels."""
    focal = size / 2 / math.tan(math.radians(FIELD_OF_VIEW) / 2)
    middle = (size - 1) / 2
    return np.array([[focal, 0.0, middle], [0.0, focal, middle], [0.0, 0.0, 1.0]])


def orbit_camera(stage: Stage, azimuth: float, elevation: float) -> Float64:
    """The rigid transform (4, 4) into a camera (OpenCV axes) that looks at the stage's centre.

    Args:
        stage: what it looks at.
        azimuth: degrees counter-clockwise seen from above; 0 = in front.
        elevation: degrees above the centre, in (-90, 90).
    """
    up = stage.up / np.linalg.norm(stage.up)
    front = _flat(stage.front, up)
    side = np.cross(up, front)
    a, e = math.radians(azimuth), math.radians(elevation)
    outward = math.cos(e) * (math.cos(a) * front + math.sin(a) * side) + math.sin(e) * up
    distance = stage.radius / math.sin(math.radians(FIELD_OF_VIEW) / 2)
    forward = -outward
    right = np.cross(forward, up)
    right = right / np.linalg.norm(right)
    down = np.cross(forward, right)
    rotation = np.stack([right, down, forward])  # rows: the camera's axes
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ (stage.centre + distance * outward)
    return matrix


def _flat(front: Float64, up: Float64) -> Float64:
    """The unit vector of `front` along the ground; any, where it points up or down (handstand)."""
    flat = front - up * (front @ up)
    if np.linalg.norm(flat) < 1e-6:
        other = np.eye(3)[np.argmin(np.abs(up))]
        flat = other - up * (other @ up)
    unit: Float64 = flat / np.linalg.norm(flat)
    return unit
