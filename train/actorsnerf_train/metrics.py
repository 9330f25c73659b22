"""How near a rendered picture is to the true one, under named conventions.

The same pictures give different numbers under different conventions, so a number is never printed
without its convention's name:

* `paper`: the whole picture; SSIM with a data range of 2. The released code hands float pictures
  to scikit-image 0.17 without a range, which then takes the range of the dtype, -1 to 1.
* `strict`: the whole picture; SSIM with the true range of the pictures, 1.
* `box`: PSNR over the pixels whose ray meets the body's box; SSIM (range 1) and LPIPS over the
  smallest rectangle around them. Much lower, as empty background no longer counts.

LPIPS (VGG-16, v0.1) is given times 1000, as in the paper's tables.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from actorsnerf_datasets.errors import UserError

ConventionName = Literal["paper", "strict", "box"]
Lpips = Callable[[Tensor, Tensor], Tensor]
"""Distance of two pictures (height, width, 3) in [0, 1]; a scalar tensor."""

PSNR_CAP = 100.0
"""Decibel given to equal pictures, whose PSNR is infinite and has no place in JSON or a mean."""
SSIM_WINDOW = 7
"""Side of the uniform window, pixels (scikit-image's default)."""
_K1 = 0.01
_K2 = 0.03


@dataclass(frozen=True)
class Convention:
    """What a picture is compared on."""

    ssim_range: float
    """Peak minus floor that SSIM's constants are scaled by."""
    region: Literal["whole", "box"]


@dataclass(frozen=True)
class Scores:
    """One picture under one convention."""

    psnr: float
    """Decibel, peak 1; at most `PSNR_CAP`."""
    ssim: float
    lpips_x1000: float | None
    """None where LPIPS was not computed."""


CONVENTIONS: Mapping[ConventionName, Convention] = {
    "paper": Convention(ssim_range=2.0, region="whole"),
    "strict": Convention(ssim_range=1.0, region="whole"),
    "box": Convention(ssim_range=1.0, region="box"),
}


def psnr(truth: Float[Tensor, "*pixels 3"], prediction: Float[Tensor, "*pixels 3"]) -> float:
    """Peak signal-to-noise ratio in decibel for a peak of 1, at most `PSNR_CAP`.

    >>> round(psnr(torch.zeros(4, 4, 3), torch.full((4, 4, 3), 0.1)), 4)
    20.0
    """
    error = torch.mean((truth.double() - prediction.double()) ** 2)
    return float(torch.clamp(-10.0 * torch.log10(error), max=PSNR_CAP))


def ssim(
    truth: Float[Tensor, "height width 3"],
    prediction: Float[Tensor, "height width 3"],
    data_range: float,
) -> float:
    """Structural similarity: uniform 7x7 window, sample covariance, border cropped, channel mean.

    Equal to `skimage.metrics.structural_similarity(truth, prediction, channel_axis=2,
    data_range=data_range)` on float64 pictures.

    Raises:
        UserError: the pictures are smaller than the window.
    """
    height, width = truth.shape[:2]
    if min(height, width) < SSIM_WINDOW:
        raise UserError(
            f"SSIM needs at least {SSIM_WINDOW}x{SSIM_WINDOW} pixels, the compared region has "
            f"{width}x{height}: evaluate larger pictures."
        )
    x = truth.double().movedim(2, 0)[:, None]
    y = prediction.double().movedim(2, 0)[:, None]
    mean_x, mean_y = _window_mean(x), _window_mean(y)
    sample = SSIM_WINDOW**2 / (SSIM_WINDOW**2 - 1)  # of a covariance over the window's 49 pixels
    variance_x = sample * (_window_mean(x * x) - mean_x**2)
    variance_y = sample * (_window_mean(y * y) - mean_y**2)
    covariance = sample * (_window_mean(x * y) - mean_x * mean_y)
    c1, c2 = (_K1 * data_range) ** 2, (_K2 * data_range) ** 2
    luminance = (2 * mean_x * mean_y + c1) / (mean_x**2 + mean_y**2 + c1)
    structure = (2 * covariance + c2) / (variance_x + variance_y + c2)
    return float(torch.mean(luminance * structure))


def compare(
    truth: Float[Tensor, "height width 3"],
    prediction: Float[Tensor, "height width 3"],
    box: Bool[Tensor, "height width"],
    conventions: Sequence[ConventionName],
    lpips: Lpips | None,
) -> dict[ConventionName, Scores]:
    """The scores of one picture under each convention.

    Args:
        truth: whole picture, nominally in [0, 1]; not clipped.
        prediction: the same size; neither clipped nor quantised.
        box: pixels whose ray meets the body's box.
        conventions: which to compute.
        lpips: None leaves `lpips_x1000` None.

    Raises:
        UserError: a region is too small, or the box lies outside the picture.
    """
    scores: dict[ConventionName, Scores] = {}
    distances: dict[str, float | None] = {}  # LPIPS is slow; `paper` and `strict` share theirs
    for name in conventions:
        convention = CONVENTIONS[name]
        rows, columns = _region(box, convention.region)
        true_part, made_part = truth[rows, columns], prediction[rows, columns]
        inside = box if convention.region == "box" else torch.ones_like(box)
        if convention.region not in distances:
            distances[convention.region] = _lpips_x1000(lpips, true_part, made_part)
        scores[name] = Scores(
            psnr=psnr(truth[inside], prediction[inside]),
            ssim=ssim(true_part, made_part, convention.ssim_range),
            lpips_x1000=distances[convention.region],
        )
    return scores


def mean_scores(scores: Sequence[Scores]) -> Scores:
    """The arithmetic mean over pictures; LPIPS is None unless every picture has it.

    >>> mean_scores([Scores(20.0, 0.5, None), Scores(30.0, 0.7, 40.0)])
    Scores(psnr=25.0, ssim=0.6, lpips_x1000=None)
    """
    distances = [score.lpips_x1000 for score in scores if score.lpips_x1000 is not None]
    return Scores(
        psnr=sum(score.psnr for score in scores) / len(scores),
        ssim=sum(score.ssim for score in scores) / len(scores),
        lpips_x1000=sum(distances) / len(scores) if len(distances) == len(scores) else None,
    )


def _window_mean(
    image: Float[Tensor, "channels 1 height width"],
) -> Float[Tensor, "channels 1 inner_height inner_width"]:
    across = functional.avg_pool2d(image, (1, SSIM_WINDOW), stride=1)
    return functional.avg_pool2d(across, (SSIM_WINDOW, 1), stride=1)


def _region(
    box: Bool[Tensor, "height width"], region: Literal["whole", "box"]
) -> tuple[slice, slice]:
    if region == "whole":
        return slice(None), slice(None)
    rows = torch.nonzero(box.any(dim=1))[:, 0].tolist()
    columns = torch.nonzero(box.any(dim=0))[:, 0].tolist()
    if not rows:
        raise UserError(
            "The body's box lies outside the picture, so nothing can be compared inside it: "
            "is the camera the right one? Run: python -m actorsnerf_datasets check FILE"
        )
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _lpips_x1000(
    lpips: Lpips | None,
    truth: Float[Tensor, "height width 3"],
    prediction: Float[Tensor, "height width 3"],
) -> float | None:
    return None if lpips is None else 1000.0 * float(lpips(truth, prediction))
