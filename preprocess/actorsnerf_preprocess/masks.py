"""The person's mask in a picture of a static camera, made from the empty stage and the fitted body.

The order of trust: masks that the user gives (`given_masks`), else these.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.backgrounds import Background
from actorsnerf_preprocess.mask_evidence import Evidence, EvidenceOptions, person_evidence
from actorsnerf_preprocess.matting import matte
from actorsnerf_preprocess.silhouettes import person_box

METHOD = (
    "made: temporal median background, shadow-robust difference, GrabCut seeded by the projected"
    " body, matting against the background"
)
"""What a prepared file records about these masks."""
_NO_BOX = (0, 0, 1, 1)
"""GrabCut asks for a rectangle and does not look at it when it starts from labels."""


@dataclass(frozen=True)
class MaskOptions:
    """The numbers of the recipe; lengths are shares of the body's longer side in the picture."""

    evidence: EvidenceOptions = field(default_factory=EvidenceOptions)
    working_length: float = 480.0
    """Pixels: a longer body is cut at half the picture's size; the edge is always at full size."""
    undecided: float = 1.5
    """Evidence up to this leaves a pixel to GrabCut."""
    shadow_doubt: float = 0.02
    """A shadow-like pixel nearer than this to the fitted body is left to GrabCut."""
    closing: float = 0.008
    """Gaps as wide as this are closed."""
    iterations: int = 1
    """Of GrabCut."""


def make_mask(
    picture: UInt8, background: Background, body: UInt8, options: MaskOptions | None = None
) -> UInt8:
    """(H, W) the person's share of each pixel, 0 to 255, with an edge about one pixel soft.

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
    length = float(max(tight[3] - tight[1], tight[2] - tight[0]))
    margin = 2 + round(1.1 * options.evidence.reach * length)
    left, top, right, bottom = person_box(body, margin) or tight
    window = (slice(top, bottom), slice(left, right))
    scale = 0.5 if length > options.working_length else 1.0
    stage = Background(
        background.picture[window], background.noise[window], background.known[window]
    )
    cut = _cut(
        _resized(picture[window], scale),
        _resized_stage(stage, scale),
        np.where(_resized(body[window], scale) > 127, np.uint8(255), np.uint8(0)),
        scale * length,
        options,
    )
    height, width = body[window].shape
    cut = np.asarray(cv2.resize(cut, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8)
    alpha[window] = matte(picture[window], stage, cut, length)
    return alpha


def mask_scores(predicted: UInt8, truth: UInt8, tolerance: int = 2) -> tuple[float, float]:
    """(intersection over union, boundary F-score) of two masks, each 1 when they agree.

    The boundary F-score is the harmonic mean of the shares of each outline that lie within
    `tolerance` pixels of the other (Martin et al., 2004; Csurka et al., 2013).

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


def _cut(
    picture: UInt8, stage: Background, body: UInt8, length: float, options: MaskOptions
) -> UInt8:
    """A hard cut: the evidence where it is clear, GrabCut's colour models where it is not."""
    evidence = person_evidence(picture, stage, body, length, options.evidence)
    labels = _labels(evidence, options)
    if all((labels == label).any() for label in (cv2.GC_BGD, cv2.GC_FGD)) and (labels > 1).any():
        # GrabCut's own random start would depend on what ran before in this process.
        cv2.setRNGSeed(0)
        first, second = np.zeros((1, 65)), np.zeros((1, 65))
        turns, mode = options.iterations, cv2.GC_INIT_WITH_MASK
        cv2.grabCut(np.ascontiguousarray(picture), labels, _NO_BOX, first, second, turns, mode)
    radius = max(round(options.closing * length), 1)
    person = cv2.morphologyEx(labels & 1, cv2.MORPH_CLOSE, _disc(radius))
    person = cv2.morphologyEx(person, cv2.MORPH_OPEN, _disc(1))
    return _connected(np.asarray(person, np.uint8), body)


def _labels(evidence: Evidence, options: MaskOptions) -> UInt8:
    """GrabCut's labels: certain where the evidence is strong and no shadow is in question."""
    doubtful = np.abs(evidence.person) < options.undecided
    doubtful |= evidence.shadow_like & (evidence.signed_distance > -options.shadow_doubt)
    person = evidence.person > 0
    certain = np.where(person, cv2.GC_FGD, cv2.GC_BGD)
    probable = np.where(person, cv2.GC_PR_FGD, cv2.GC_PR_BGD)
    return np.where(doubtful, probable, certain).astype(np.uint8)


def _connected(person: UInt8, body: UInt8) -> UInt8:
    """The parts that touch the fitted body."""
    count, parts = cv2.connectedComponents(person, connectivity=8)
    touching = np.zeros(count, np.bool_)
    touching[np.unique(np.asarray(parts)[(body > 0) & (person > 0)])] = True
    return np.asarray(touching[parts], np.uint8)


def _resized(picture: UInt8, scale: float) -> UInt8:
    if scale == 1.0:
        return picture
    return np.asarray(cv2.resize(picture, _size(picture, scale), interpolation=cv2.INTER_AREA))


def _resized_stage(stage: Background, scale: float) -> Background:
    noise = cv2.dilate(stage.noise, np.ones((3, 3), np.uint8))
    size = _size(stage.picture, scale)
    known = cv2.resize(stage.known.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return Background(
        _resized(stage.picture, scale),
        np.asarray(cv2.resize(noise, size), np.float32),
        np.asarray(known) > 0,
    )


def _size(picture: UInt8, scale: float) -> tuple[int, int]:
    height, width = picture.shape[:2]
    return max(round(width * scale), 1), max(round(height * scale), 1)


def _disc(radius: int) -> UInt8:
    side = 2 * radius + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def _outline(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels of the mask with a neighbour outside it (the picture's border counts as outside)."""
    padded = np.pad(mask.astype(np.uint8), 1)
    eroded = cv2.erode(padded, np.ones((3, 3), np.uint8))
    return np.asarray(mask & (np.asarray(eroded)[1:-1, 1:-1] == 0), np.bool_)


def _near(outline: NDArray[np.bool_], tolerance: int) -> NDArray[np.bool_]:
    distance = cv2.distanceTransform((~outline).astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(distance <= tolerance, np.bool_)
