"""Soft edges where the stage behind the person is known."""

import cv2
import numpy as np

from actorsnerf_datasets.types import Float32, UInt8
from actorsnerf_preprocess.backgrounds import Background

_LEAST_CONTRAST = 10.0
"""Grey values between person and stage below which the picture does not say where the edge is."""


def matte(picture: UInt8, stage: Background, cut: UInt8, length: float) -> UInt8:
    """(H, W) the person's share of each pixel, 0 to 255, near the edge of a hard cut.

    In a narrow band `I = a F + (1 - a) B` is solved for a, with B the known stage and F the mean
    colour of the person a little farther inside: the edge lands where the picture has it, also
    between pixels. Where person and stage look alike, or the stage is not known, the cut's own
    edge is blurred a little.

    Args:
        picture: (H, W, 3).
        stage: the same window of the background.
        cut: (H, W) nonzero on the person.
        length: longer side of the body's box, pixels; the band is about a hundredth of it.
    """
    person = (cut > 0).astype(np.uint8)
    core = np.asarray(cv2.erode(person, _disc(max(round(0.005 * length), 1))), np.uint8)
    wide = cv2.dilate(person, _disc(max(round(0.0022 * length), 1)))
    window = 2 * max(round(0.0085 * length), 2) + 1
    inner, weight = _mean_inside(picture, core, window)
    shown = cv2.GaussianBlur(picture, (0, 0), 0.5).astype(np.float32)
    empty = cv2.GaussianBlur(stage.picture, (0, 0), 0.5).astype(np.float32)
    contrast = inner - empty
    power = (contrast * contrast).sum(2)
    share = ((shown - empty) * contrast).sum(2) / np.maximum(power, 1.0)
    solved = (weight > 0) & (power > 3 * _LEAST_CONTRAST**2) & stage.known
    blurred = cv2.GaussianBlur(person.astype(np.float32), (0, 0), 0.8)
    alpha = np.where(solved, np.clip(share, 0.0, 1.0), blurred)
    alpha = np.where(core > 0, 1.0, np.where(wide > 0, alpha, 0.0))
    return np.asarray(np.rint(255.0 * alpha), np.uint8)


def _mean_inside(picture: UInt8, core: UInt8, window: int) -> tuple[Float32, Float32]:
    """(mean colour of the core's pixels in each window, their share of the window)."""
    share = cv2.blur(core.astype(np.float32), (window, window))
    share[share < 0.5 / window**2] = 0.0  # Running sums leave dust.
    total = cv2.blur(picture.astype(np.float32) * core[..., None], (window, window))
    return np.asarray(total / np.maximum(share, 1e-6)[..., None], np.float32), np.asarray(share)


def _disc(radius: int) -> UInt8:
    side = 2 * radius + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)
