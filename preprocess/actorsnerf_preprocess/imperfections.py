"""What makes synthetic data as imperfect as real data: fits that are a little off, ragged masks."""

import cv2
import numpy as np

from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_preprocess.motions import Motion

ANGLE_NOISE = np.deg2rad(2.0)
"""Standard deviation of each joint's rotation error, radians."""
PLACE_NOISE = 0.01
"""Standard deviation of the translation's error along each axis, metres."""
NOISE_FRAMES = 6.0
"""Frames over which errors stay alike, as a fitter's do."""
RAGGED_CELLS = 24
"""Bites and bumps are about 1/24 of the picture long..."""
RAGGED_PIXELS = 0.006
"""...and this share of the picture deep."""


def noisy(motion: Motion, rng: np.random.Generator) -> Motion:
    """The motion as a fitter might have found it."""
    frames = motion.frame_count
    poses = motion.poses + ANGLE_NOISE / np.sqrt(3) * _slow(frames, 72, rng).reshape(frames, 24, 3)
    poses[:, 0] = 0.0
    return Motion(
        poses,
        motion.global_orient + ANGLE_NOISE / np.sqrt(3) * _slow(frames, 3, rng),
        motion.transl + PLACE_NOISE * _slow(frames, 3, rng),
        motion.frames_per_second,
    )


def ragged(labels: UInt8, rng: np.random.Generator) -> UInt8:
    """A label mask whose outline is moved in and out by smooth noise."""
    height, width = labels.shape
    inside = (labels > 0).astype(np.uint8)
    signed = cv2.distanceTransform(inside, cv2.DIST_L2, 5) - cv2.distanceTransform(
        1 - inside, cv2.DIST_L2, 5
    )
    coarse = rng.normal(0, 1, (RAGGED_CELLS, RAGGED_CELLS)).astype(np.float32)
    moved = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    kept = signed + RAGGED_PIXELS * max(height, width) * moved > 0
    reach = 2 * int(np.ceil(4 * RAGGED_PIXELS * max(height, width))) + 1
    grown = cv2.dilate(labels, np.ones((reach, reach), dtype=np.uint8))
    return np.where(kept, np.where(labels > 0, labels, grown), 0).astype(np.uint8)


def _slow(frames: int, channels: int, rng: np.random.Generator) -> Float64:
    """(frames, channels) unit noise that changes over NOISE_FRAMES frames."""
    reach = int(4 * NOISE_FRAMES)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / NOISE_FRAMES) ** 2)
    kernel /= np.linalg.norm(kernel)
    white = rng.normal(0, 1, (frames + 2 * reach, channels))
    smooth: Float64 = np.stack([np.convolve(column, kernel, "valid") for column in white.T], 1)
    return smooth
