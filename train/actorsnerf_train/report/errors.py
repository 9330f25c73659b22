"""How far each contestant's pictures are from the true ones and from the reference's."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_train.metrics import PSNR_CAP, Lpips, Scores, compare, mean_scores, psnr
from actorsnerf_train.report.frames import Frame, Health
from actorsnerf_train.report.measure import Measured

SAME = 1 / 255
"""Difference of colours in [0, 1] up to which a picture counts as the reference's: one step of
8 bits."""


@dataclass(frozen=True)
class ToReference:
    """How far pictures are from the reference's, on the pixels of the box that it drew."""

    largest: float
    """Over pixels and channels, |difference of colours in [0, 1]|."""
    mean: float
    psnr: float
    """Decibel, all pixels of all frames together."""
    largest_anywhere: float | None
    """The same as `largest` over every pixel of the picture, measured to the `complete` picture,
    which equals the reference's to rounding; None where that was not drawn."""

    @property
    def same(self) -> bool:
        """Whether no pixel differs by more than one step of 8 bits."""
        return max(self.largest, self.largest_anywhere or 0.0) <= SAME


@dataclass(frozen=True)
class Errors:
    """Of one contestant."""

    truth: Scores | None
    """To the true pictures, convention `box`; None for a reference that drew only a share."""
    reference: ToReference


def errors(
    measured: Sequence[Measured], frames: Sequence[Frame], lpips: Lpips | None
) -> tuple[Errors, ...]:
    """Every contestant's errors; the reference must be the first of them."""
    complete = next((one for one in measured if one.contestant.name == "complete"), None)
    return tuple(
        Errors(to_truth(one, frames, lpips), to_reference(one, measured[0], complete))
        for one in measured
    )


def to_reference(one: Measured, reference: Measured, complete: Measured | None) -> ToReference:
    """The distance to the reference on its pixels, and to `complete` on all."""
    apart = []
    for drawn, truth in zip(one.drawn, reference.drawn, strict=True):
        assert truth.pixels is not None
        apart.append((_at(drawn.rendering.rgb, truth.pixels) - truth.rendering.rgb).reshape(-1))
    difference = torch.cat(apart)
    zero = torch.zeros(difference.shape[0] // 3, 3, dtype=difference.dtype)
    anywhere = None
    if complete is not None and one is not reference:
        anywhere = max(
            float((a.rendering.rgb - b.rendering.rgb).abs().max())
            for a, b in zip(one.drawn, complete.drawn, strict=True)
        )
    return ToReference(
        float(difference.abs().max()),
        float(difference.abs().mean()),
        psnr(zero, difference.cpu().reshape(-1, 3)),
        anywhere,
    )


def to_truth(one: Measured, frames: Sequence[Frame], lpips: Lpips | None) -> Scores | None:
    """Mean scores to the true pictures inside the body's box; None without whole pictures."""
    scores = []
    for drawn, frame in zip(one.drawn, frames, strict=True):
        picture = drawn.rendering.rgb.cpu()
        if drawn.pixels is not None:
            if drawn.pixels.shape[0] < int(frame.box.sum()):
                return None
            # Beside the box the reference sees the background, as the truth does.
            whole = frame.truth.clone()
            whole[drawn.pixels[:, 1], drawn.pixels[:, 0]] = picture
            picture = whole
        scores.append(compare(frame.truth, picture, frame.box, ("box",), lpips)["box"])
    return mean_scores(scores)


def health(complete: Measured, scores: Scores | None, frames: Sequence[Frame]) -> Health:
    """How well trained the actor is, by its complete pictures."""
    inside = [
        float(drawn.rendering.alpha.cpu()[frame.mask].mean())
        for drawn, frame in zip(complete.drawn, frames, strict=True)
    ]
    return Health(sum(inside) / len(inside), PSNR_CAP if scores is None else scores.psnr)


def _at(picture: Float[Tensor, "*pixels 3"], pixels: Tensor) -> Float[Tensor, "rays 3"]:
    """The colours at x, y; of the reference itself, which has no others, all."""
    return picture[pixels[:, 1], pixels[:, 0]] if picture.ndim == 3 else picture


__all__ = ["SAME", "Errors", "ToReference", "errors", "health", "to_reference", "to_truth"]
