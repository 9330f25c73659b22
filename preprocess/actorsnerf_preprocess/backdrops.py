"""Empty stages behind synthetic actors: a dark studio, or a lit hall with a wall and a floor."""

import cv2
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float32, Float64, UInt8
from actorsnerf_preprocess.renderer import Pinhole

STUDIO_GREY = 26.0
HALL_WALL = (168.0, 158.0, 150.0)
HALL_FLOOR = (128.0, 112.0, 96.0)
PLANK = 0.35
"""Width of the hall's floor boards, metres."""
TEXTURE = 5.0
"""Standard deviation of the fine texture, grey values; it does not change with time."""


def studio(pinhole: Pinhole, rng: np.random.Generator) -> UInt8:
    """A dark curtain, as (H, W, 3)."""
    width, height = pinhole.size
    cloth = _clouds((height, width), 10, rng) * 5
    folds = 5 * np.sin(np.arange(width) / width * rng.uniform(60, 90) + rng.uniform(0, 6))
    grey = STUDIO_GREY + cloth + folds
    grain = rng.normal(0, 1.5, (height, width, 3))
    curtain: UInt8 = np.clip(grey[..., None] * (1.0, 1.02, 1.08) + grain, 0, 255).astype(np.uint8)
    return curtain


def hall(pinhole: Pinhole, rng: np.random.Generator) -> UInt8:
    """A textured wall over a floor of boards that lies at y = 0, as (H, W, 3)."""
    width, height = pinhole.size
    floor, ground = _floor_points(pinhole)
    boards = np.floor(ground[..., 0] / PLANK)
    shade = 1 + 0.06 * np.sin(boards * 12.9898) + 0.04 * np.sin(ground[..., 1] * 9 + boards * 3)
    wall = np.array(HALL_WALL) * (1 + 0.12 * _clouds((height, width), 5, rng))[..., None]
    colours = np.where(floor[..., None], np.array(HALL_FLOOR) * shade[..., None], wall)
    colours += TEXTURE * _clouds((height, width), max(width // 4, 4), rng)[..., None]
    empty: UInt8 = np.clip(colours, 0, 255).astype(np.uint8)
    return empty


def _floor_points(pinhole: Pinhole) -> tuple[NDArray[np.bool_], Float64]:
    """Whether each pixel's ray meets the floor within 12 m, and where (x, z)."""
    width, height = pinhole.size
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(pinhole.K).T @ pinhole.R
    centre = -pinhole.R.T @ pinhole.T
    down = np.minimum(rays[..., 1], -1e-6)
    distance = -centre[1] / down
    ground = centre + distance[..., None] * rays
    near: NDArray[np.bool_] = (rays[..., 1] < 0) & (np.abs(ground).max(axis=-1) < 12)
    return near, ground[..., [0, 2]]


def _clouds(shape: tuple[int, int], cells: int, rng: np.random.Generator) -> Float32:
    """Smooth noise of about unit deviation with `cells` across."""
    coarse = rng.normal(0, 1, (cells, cells)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)
