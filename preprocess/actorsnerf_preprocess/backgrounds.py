"""The empty stage behind a person, from pictures of a camera that does not move."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float32, UInt8

SAMPLE_COUNT = 24
"""Pictures the background is made from; a 1920 x 1080 picture with its cover takes 8 MB."""
MIN_SEEN = 3
"""A pixel seen empty in fewer pictures than this is not known."""
_STRIP_ROWS = 64
_NOISE_FLOOR = 2.0
"""Grey values; no camera and codec is quieter."""


@dataclass(frozen=True)
class Background:
    """A camera's empty stage."""

    picture: UInt8
    """(H, W, 3) RGB."""
    noise: Float32
    """(H, W) grey values: how much the picture varies where nobody stands, at least 2."""
    known: NDArray[np.bool_]
    """(H, W) whether enough pictures show the stage here; elsewhere it is filled in."""


def save_background(path: Path, background: Background) -> None:
    """Leaves a background at `path`, for `load_background`.

    Raises:
        OSError: the disk refuses.
    """
    with path.open("wb") as file:
        np.savez(file, picture=background.picture, noise=background.noise, known=background.known)


def load_background(path: Path) -> Background:
    """What `save_background` left, bit for bit.

    Raises:
        OSError: there is no such file.
    """
    with np.load(path) as arrays:
        return Background(arrays["picture"], arrays["noise"], arrays["known"])


@dataclass(frozen=True)
class StageSample:
    """One picture of a camera and where a person may be in it."""

    picture: UInt8
    """(H, W, 3) RGB."""
    near: NDArray[np.bool_]
    """(H, W) where hair and clothes could be."""
    covered: NDArray[np.bool_]
    """(H, W) where the person most likely is; part of `near`."""


def estimate_background(samples: Sequence[StageSample]) -> Background:
    """The temporal median of what the samples show of the stage.

    Pixels near the projected body do not vote, so a dancer who stays at one place does not become
    background. Where that leaves too few votes, only those under the body are left out. Pixels
    never seen are filled in from their surroundings and marked.

    Args:
        samples: at least one; all of one size.
    """
    height, width = samples[0].covered.shape
    picture = np.empty((height, width, 3), np.uint8)
    spread = np.empty((height, width), np.float32)
    seen = np.empty((height, width), np.int64)
    for top in range(0, height, _STRIP_ROWS):
        rows = slice(top, top + _STRIP_ROWS)
        picture[rows], spread[rows], seen[rows] = _strip(samples, rows)
    known = seen >= min(MIN_SEEN, len(samples))
    if not known.all() and known.any():
        picture = np.asarray(
            cv2.inpaint(picture, (~known).astype(np.uint8), 3, cv2.INPAINT_TELEA), np.uint8
        )
        spread[~known] = np.median(spread[known])
    noise = np.maximum(cv2.blur(spread, (7, 7)), _NOISE_FLOOR).astype(np.float32)
    return Background(picture, noise, known)


def _strip(samples: Sequence[StageSample], rows: slice) -> tuple[UInt8, Float32, NDArray[np.int64]]:
    """Median, mean absolute deviation and votes of some rows."""
    least = min(MIN_SEEN, len(samples))
    near = np.stack([sample.near[rows] for sample in samples], -1)
    covered = np.stack([sample.covered[rows] for sample in samples], -1)
    covered = np.where((~near).sum(-1, keepdims=True) >= least, near, covered)
    values = np.stack([sample.picture[rows] for sample in samples], -1)
    votes = (~covered).sum(-1)
    # Covered samples sort to the end, behind the middle of those that vote.
    ordered = np.sort(np.where(covered[:, :, None], np.uint8(255), values), axis=-1)
    middle = np.clip((votes - 1) // 2, 0, len(samples) - 1)
    median = np.take_along_axis(ordered, middle[:, :, None, None], -1)
    deviation = np.abs(values.astype(np.int16) - median).mean(2, dtype=np.float32)
    spread = np.where(covered, 0, deviation).sum(-1) / np.maximum(votes, 1)
    return median[..., 0], spread.astype(np.float32), votes
