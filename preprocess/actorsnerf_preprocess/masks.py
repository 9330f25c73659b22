"""The person's mask in a picture of a static camera, made from the background and the body.

The order of trust: masks that the user gives (`given_masks`), else these. Source of the recipe:
background difference with the brightness and chromaticity distortion of Horprasert et al. (1999)
against soft shadows, and GrabCut (Rother et al., 2004) seeded by the projected body.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float32, UInt8
from actorsnerf_preprocess.backgrounds import Background
from actorsnerf_preprocess.silhouettes import person_box

METHOD = "made: temporal median background, difference, GrabCut seeded by the projected body"
"""What a prepared file records about these masks."""


@dataclass(frozen=True)
class MaskOptions:
    """The numbers of the recipe; lengths are shares of the body's height in the picture."""

    reach: float = 0.12
    """How far hair and clothes may stand out from the body."""
    core: float = 0.025
    """How far inside the projected body a pixel is certainly the person's."""
    certain: float = 8.0
    """Difference, in units of the stage's noise, above which a pixel is not the stage."""
    same: float = 3.0
    """Difference, in units of the stage's noise, below which a pixel is the stage."""
    darkest_shadow: float = 0.45
    """A shadow leaves at least this share of the stage's light."""
    iterations: int = 2
    """Of GrabCut."""


def make_mask(
    picture: UInt8, background: Background, body: UInt8, options: MaskOptions | None = None
) -> UInt8:
    """(H, W) the person's share of each pixel, 0 to 255, with an edge one pixel soft.

    Args:
        picture: (H, W, 3) RGB, distorted as the source has it.
        background: of the same camera.
        body: (H, W) silhouette of the fitted body in this picture.
        options: the recipe's numbers.

    Returns:
        All zero if the body lies outside the picture.
    """
    options = options or MaskOptions()
    tight = person_box(body, 0)
    alpha = np.zeros(body.shape, np.uint8)
    if tight is None:
        return alpha
    height = float(max(tight[3] - tight[1], tight[2] - tight[0]))
    box = person_box(body, round(1.5 * options.reach * height) + 2)
    assert box is not None
    window = (slice(box[1], box[3]), slice(box[0], box[2]))
    stage = Background(
        background.picture[window], background.noise[window], background.known[window]
    )
    alpha[window] = _cut(picture[window], stage, body[window], height, options)
    return alpha


def mask_scores(predicted: UInt8, truth: UInt8, tolerance: int = 2) -> tuple[float, float]:
    """(intersection over union, boundary F-score) of two masks, each 1 when they agree.

    The boundary F-score is the harmonic mean of the shares of each outline that lie within
    `tolerance` pixels of the other (Martin et al., 2004; Csurka et al., 2013).

    >>> import numpy as np
    >>> mask = np.zeros((8, 8), np.uint8)
    >>> mask[2:6, 2:6] = 255
    >>> mask_scores(mask, mask)
    (1.0, 1.0)
    """
    first, second = predicted >= 128, truth >= 128
    union = int((first | second).sum())
    overlap = float((first & second).sum()) / union if union else 1.0
    first_edge, second_edge = _outline(first), _outline(second)
    if not first_edge.any() or not second_edge.any():
        return overlap, float(first_edge.any() == second_edge.any())
    precision = float(_near(second_edge, tolerance)[first_edge].mean())
    recall = float(_near(first_edge, tolerance)[second_edge].mean())
    total = precision + recall
    return overlap, 2 * precision * recall / total if total else 0.0


def stage_difference(
    picture: UInt8, stage: Background, darkest_shadow: float
) -> tuple[Float32, Float32]:
    """(plain, shadow-free) difference of each pixel from the stage, in units of its noise.

    The shadow-free one lets the stage be dimmed to between `darkest_shadow` and 1: what remains is
    a change of colour, or of light beyond that of a shadow.
    """
    shown = picture.astype(np.float32)
    empty = stage.picture.astype(np.float32)
    plain = np.abs(shown - empty).mean(2)
    light = (shown * empty).sum(2) / np.maximum((empty * empty).sum(2), 1.0)
    dimmed = np.clip(light, darkest_shadow, 1.0)[..., None] * empty
    return plain / stage.noise, np.abs(shown - dimmed).mean(2) / stage.noise


def _cut(
    picture: UInt8, stage: Background, body: UInt8, height: float, options: MaskOptions
) -> UInt8:
    """GrabCut inside the body's box, from labels that the difference and the body agree on."""
    smooth = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8), np.uint8)
    plain, changed = stage_difference(smooth, stage, options.darkest_shadow)
    outside = np.asarray(cv2.distanceTransform(255 - body, cv2.DIST_L2, 5), np.float32) / height
    inside = np.asarray(cv2.distanceTransform(body, cv2.DIST_L2, 5), np.float32) / height
    reachable = outside < options.reach
    likely = np.where(stage.known, (changed > options.certain) & reachable, body > 0)
    labels = np.where(likely, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[(inside > options.core) & ((plain > options.same) | ~stage.known)] = cv2.GC_FGD
    labels[~reachable | (stage.known & (plain < options.same) & (inside < options.core))] = (
        cv2.GC_BGD
    )
    if (labels & 1).any() and not (labels & 1).all():
        cv2.grabCut(
            np.ascontiguousarray(picture[..., ::-1]),
            labels,
            None,
            np.zeros((1, 65)),
            np.zeros((1, 65)),
            options.iterations,
            cv2.GC_INIT_WITH_MASK,
        )
    return _soft(_connected((labels & 1).astype(np.uint8) * 255, body))


def _connected(mask: UInt8, body: UInt8) -> UInt8:
    """The parts of a mask that touch the body, their small holes filled."""
    count, parts = cv2.connectedComponents(mask, connectivity=8)
    touching = np.zeros(count, bool)
    touching[np.unique(parts[(body > 0) & (mask > 0)])] = True
    touching[0] = False
    return np.asarray(
        cv2.morphologyEx(
            touching[parts].astype(np.uint8) * 255, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
        ),
        np.uint8,
    )


def _soft(mask: UInt8) -> UInt8:
    """The mask with an edge about one pixel wide."""
    return np.asarray(cv2.GaussianBlur(mask, (3, 3), 0.6), np.uint8)


def _outline(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels of the mask with a neighbour outside it (the picture's border counts as outside)."""
    padded = np.pad(mask.astype(np.uint8), 1)
    eroded = cv2.erode(padded, np.ones((3, 3), np.uint8))
    return mask & (np.asarray(eroded)[1:-1, 1:-1] == 0)


def _near(outline: NDArray[np.bool_], tolerance: int) -> NDArray[np.bool_]:
    distance = cv2.distanceTransform((~outline).astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(distance) <= tolerance
