"""What speaks for a pixel being the person: the stage's absence, no shadow, the body's nearness."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float32, UInt8
from actorsnerf_preprocess.backgrounds import Background

_FURTHEST = 9.0
_DETAIL_SIGMA = 1.5
_DIMMEST_STAGE = 8.0
"""Grey values: below this a ratio to the stage says nothing."""
_BRIGHTEST_SHADOW = 1.03


@dataclass(frozen=True)
class EvidenceOptions:
    """The numbers of the evidence; lengths are shares of the body's longer side in the picture."""

    threshold: float = 3.5
    """Difference from the stage, in units of its noise, that is as likely the person as not."""
    weight: float = 0.5
    """Evidence per unit of difference above the threshold."""
    saturation: float = 16.0
    """Difference, in units of noise, beyond which more says nothing more."""
    darkest_shadow: float = 0.45
    """A shadow leaves at least this share of the stage's light."""
    shadow_detail: float = 3.0
    """What a shadow may differ from the evenly dimmed stage, in units of noise."""
    shadow_smoothness: float = 4.0
    """Pixels: a soft shadow changes slowly compared to this."""
    reach: float = 0.2
    """How far hair and clothes may stand out from the fitted body."""
    body_weight: float = 0.6
    """Evidence of lying inside the fitted body, or (negative) outside."""
    body_softness: float = 0.03
    """How far the fitted body may be wrong."""


@dataclass(frozen=True)
class Evidence:
    """Per pixel of a window."""

    person: Float32
    """(H, W) positive for the person, negative for the stage; 0 is undecided."""
    shadow_like: NDArray[np.bool_]
    """(H, W) differs from the stage as a shadow would."""
    signed_distance: Float32
    """(H, W) to the outline of the fitted body, positive inside, in body lengths."""


def person_evidence(
    picture: UInt8, stage: Background, body: UInt8, length: float, options: EvidenceOptions
) -> Evidence:
    """How the picture, the empty stage and the fitted body vote, pixel by pixel.

    A difference that a soft shadow explains (the stage dimmed evenly, Horprasert et al., 1999)
    does not count outside the fitted body: the grey of clothes and the grey of a shadow on a grey
    stage cannot be told apart, but shadows fall beside the body. Where the stage is not known, only
    pixels well inside or well outside the fitted body are decided.

    Args:
        picture: (H, W, 3) RGB.
        stage: the same window of the background.
        body: (H, W) silhouette of the fitted body.
        length: longer side of the body's box, pixels.
        options: the numbers.
    """
    shown = cv2.GaussianBlur(picture, (0, 0), 0.7).astype(np.float32)
    empty = cv2.GaussianBlur(stage.picture, (0, 0), 0.7).astype(np.float32)
    signed = _signed_distance(body) / length
    plain = _root_mean_square(shown - empty) / stage.noise
    shadow = _shadow(shown, empty, stage.noise, options)
    outside = 1.0 - _sigmoid(signed / 0.004)
    unexplained = plain * (1.0 - shadow * outside)
    near = np.clip(signed / options.body_softness, -1.0, 1.0)
    vote = options.weight * (np.minimum(unexplained, options.saturation) - options.threshold)
    unseen = np.where(
        near >= 1.0, _FURTHEST, np.where(signed < -2 * options.body_softness, -_FURTHEST, near)
    )
    vote = np.where(stage.known, vote + near * options.body_weight, unseen)
    vote[signed < -options.reach] = -_FURTHEST
    return Evidence(
        person=vote.astype(np.float32),
        shadow_like=(shadow > 0.5) & (plain > options.threshold),
        signed_distance=signed,
    )


def _shadow(shown: Float32, empty: Float32, noise: Float32, options: EvidenceOptions) -> Float32:
    """How well an even dimming explains each pixel, 0 to 1."""
    light = (shown * empty).sum(2) / np.maximum((empty * empty).sum(2), 1.0)
    dimmed = np.clip(light, options.darkest_shadow, _BRIGHTEST_SHADOW)[..., None] * empty
    colour_change = _root_mean_square(shown - dimmed)
    brightness = empty.mean(2)
    ratio = shown.mean(2) / np.maximum(brightness, _DIMMEST_STAGE)
    # The person's own pixels would make the shadow beside them look uneven.
    counts = (colour_change < options.shadow_detail * noise).astype(np.float32)
    smooth = _mean_of(ratio, counts, options.shadow_smoothness)
    detail = _mean_of(np.abs(ratio - smooth) * brightness, counts, _DETAIL_SIGMA)
    surprise = np.maximum(colour_change, detail) / noise
    possible = (light > options.darkest_shadow) & (light < _BRIGHTEST_SHADOW)
    return np.asarray(possible * _sigmoid(2.0 * (options.shadow_detail - surprise)), np.float32)


def _mean_of(values: Float32, counts: Float32, sigma: float) -> Float32:
    """The Gaussian mean around each pixel of the values that count; 0 where none does."""
    weight = cv2.GaussianBlur(counts, (0, 0), sigma)
    total = cv2.GaussianBlur(values * counts, (0, 0), sigma)
    return np.asarray(total / np.maximum(weight, 1e-3), np.float32)


def _signed_distance(body: UInt8) -> Float32:
    inside = cv2.distanceTransform(body, cv2.DIST_L2, 5)
    outside = cv2.distanceTransform(255 - body, cv2.DIST_L2, 5)
    return np.asarray(inside - outside, np.float32)


def _root_mean_square(difference: Float32) -> Float32:
    return np.asarray(np.sqrt((difference * difference).mean(2)), np.float32)


def _sigmoid(value: NDArray[np.floating]) -> Float32:
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(value, -20.0, 20.0))), np.float32)
