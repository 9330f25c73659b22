"""Which frames of a monocular video show the most of a body: the automatic choice of frames."""

import numpy as np

from actorsnerf_datasets.cameras import camera_centre
from actorsnerf_datasets.skeleton import joint_transforms
from actorsnerf_datasets.types import BodyFits, Camera, Float64

DIRECTION_COUNT = 64
"""Directions on the sphere around each bone. 64 lie about 25 degrees apart."""
_DIGITS = 9
"""Gains are compared to this many digits, so that rounding never decides."""


def view_directions(fits: BodyFits, camera: Camera) -> Float64:
    """Unit vectors (frames, 24, 3) from each joint to the camera, in the bone's own rest frame.

    A bone that turns together with the camera's view keeps its direction; a bone that turns
    relative to the camera shows another side.
    """
    count = len(fits.body_pose)
    pose = np.concatenate([np.zeros((count, 1, 3)), fits.body_pose], axis=1)
    bone_rotation = joint_transforms(pose, fits.rest_joints)[..., :3, :3]
    centre_world = camera_centre(camera.R, camera.T)
    from_body = centre_world - fits.world_from_body[:, :3, 3]
    centre_body = np.einsum("fji,fj->fi", fits.world_from_body[:, :3, :3], from_body)
    rays: Float64 = centre_body[:, None] - fits.posed_joints
    rays = np.einsum("fbji,fbj->fbi", bone_rotation, rays)
    length: Float64 = np.linalg.norm(rays, axis=-1, keepdims=True)
    return rays / length


def visibility(directions: Float64) -> Float64:
    """How well each view shows each side of each bone, (frames, bones, 64), 0 to 1.

    The sides are 64 directions spread evenly over the sphere; a side is shown with the cosine of
    the angle between it and the view, and not at all from behind.

    Args:
        directions: (frames, bones, 3) unit vectors towards the camera.
    """
    cosines: Float64 = np.einsum("fbi,si->fbs", directions, _sphere())
    return np.maximum(cosines, 0.0)


def choose_frames(seen: Float64, count: int) -> list[int]:
    """Positions of `count` frames, best first: a greedy choice that covers the body.

    The rule: each side of each bone is worth the square root of the visibility summed over the
    chosen frames, so a side that was seen already is worth less the next time. Take the frame that
    adds the most, the earliest on a tie; repeat. No chance is involved, and a shorter list is the
    beginning of a longer one. Greedy choice reaches at least 63 % of the best value possible.

    Args:
        seen: (frames, bones, sides) from `visibility`.
        count: at most this many; all frames if there are fewer.

    >>> front, back = [1.0, 0.0], [0.0, 1.0]
    >>> choose_frames(np.array([front, front, back])[:, None], 2)
    [0, 2]
    """
    sides = seen.reshape(len(seen), seen.shape[1] * seen.shape[2])
    total = np.zeros(sides.shape[1])
    left = list(range(len(seen)))
    chosen: list[int] = []
    while left and len(chosen) < count:
        gains = np.sqrt(total + sides[left]).sum(axis=1) - np.sqrt(total).sum()
        best = left.pop(int(np.argmax(gains.round(_DIGITS))))
        chosen.append(best)
        total += sides[best]
    return chosen


def _sphere() -> Float64:
    """Evenly spread unit vectors (64, 3): a Fibonacci lattice."""
    step = np.arange(DIRECTION_COUNT)
    height = 1 - (2 * step + 1) / DIRECTION_COUNT
    turn = np.pi * (3 - np.sqrt(5.0)) * step
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), height, radius * np.sin(turn)], axis=-1)
