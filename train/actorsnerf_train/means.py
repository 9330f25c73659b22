"""Means of what the steps since the last line of the log were like."""

import math

import torch

from actorsnerf_train.health import Pulse
from actorsnerf_train.journal import Entry
from actorsnerf_train.objective import Outcome

NAMES = ("loss", "perceptual", "squared_error", "skinning", "inside", "outside")


class Means:
    """Sums over outcomes; a number that is absent (NaN opacity: no such pixels) is not counted."""

    def __init__(self) -> None:
        self._clear()

    def _clear(self) -> None:
        self.sums = dict.fromkeys(NAMES, 0.0)
        self.counted = dict.fromkeys(NAMES, 0)
        self.samples = 0
        self.survivors = 0

    def add(self, outcome: Outcome) -> Pulse:
        """The outcome's numbers, after they were added; one transfer from the device.

        Beside the ragged samples' counts it is all that a step waits for: what is no number must
        be noticed before it reaches the weights.
        """
        losses = outcome.losses
        tensors = (
            losses.total,
            losses.perceptual,
            losses.squared_error,
            losses.skinning,
            outcome.inside,
            outcome.outside,
        )
        values: list[float] = torch.stack([t.detach().float() for t in tensors]).tolist()
        for name, value in zip(NAMES, values, strict=True):
            if math.isfinite(value):
                self.sums[name] += value
                self.counted[name] += 1
        counts = outcome.counts
        self.samples += counts.samples
        self.survivors += counts.survivors
        return Pulse(values[0], values[4], values[5], counts.samples, counts.survivors)

    def entry(self, step: int, actor: str, rate: float, window: float, seconds: float) -> Entry:
        """The means so far as a line of the log; counting begins anew."""
        means = {
            name: self.sums[name] / self.counted[name] if self.counted[name] else math.nan
            for name in NAMES
        }
        entry = Entry(
            step=step,
            actor=actor,
            loss=means["loss"],
            perceptual=means["perceptual"],
            squared_error=means["squared_error"],
            skinning=means["skinning"],
            inside=means["inside"],
            outside=means["outside"],
            survivors=self.survivors / max(self.samples, 1),
            rate_factor=rate,
            open_bands=window,
            seconds=seconds,
        )
        self._clear()
        return entry
