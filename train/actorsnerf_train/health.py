"""Whether a training is still alive; where not, a sentence that says why it probably died."""

import math
from collections import deque
from dataclasses import dataclass

from actorsnerf_datasets.errors import UserError


class TrainingError(UserError):
    """A training that cannot go on; its last good checkpoint is kept."""


@dataclass(frozen=True)
class HealthLimits:
    """When a training counts as collapsed."""

    window: int = 100
    """Steps that are averaged."""
    grace: int = 200
    """Steps at the beginning that are not judged."""
    least_inside: float = 0.05
    """Mean opacity on the person under which the actor has vanished."""
    most_outside: float = 0.95
    """Mean opacity beside the person over which everything is fog."""


@dataclass(frozen=True)
class Pulse:
    """What one step says about the training's health."""

    loss: float
    inside: float
    """Mean rendered opacity on the person's pixels; NaN where the patches show none."""
    outside: float
    """The same beside the person."""
    samples: int
    """Ray samples inside the body's bounds."""
    survivors: int
    """Samples that went through the networks."""


class Health:
    """The last steps' pulses, and the judgement of them."""

    def __init__(self, limits: HealthLimits) -> None:
        self.limits = limits
        self.inside: deque[float] = deque(maxlen=limits.window)
        self.outside: deque[float] = deque(maxlen=limits.window)

    def check(self, pulse: Pulse, step: int, actor: str) -> None:
        """Nothing, while the training is alive.

        Raises:
            TrainingError: a loss that is no number, no usable ray, or a collapsed actor.
        """
        if not math.isfinite(pulse.loss):
            raise TrainingError(
                f"step {step}: the loss of actor {actor} is {pulse.loss}; likely causes: too high "
                "a learning rate (begin a new run with a lower --rate-scale), or float16 overflow "
                "(--precision bfloat16 or float32). The last good checkpoint is kept."
            )
        if pulse.samples == 0:
            raise TrainingError(
                f"step {step}: no ray of actor {actor}'s patches meets the body's box, so there is "
                "nothing to learn; likely cause: camera and fit disagree. Look at the file: "
                "python -m actorsnerf_datasets check FILE"
            )
        for values, value in ((self.inside, pulse.inside), (self.outside, pulse.outside)):
            if math.isfinite(value):
                values.append(value)
        self._check_collapse(step, self.limits.window)

    def conclude(self, step: int) -> None:
        """Judge the last step by what was seen, be it less than a window.

        A training that goes on from a late checkpoint would otherwise end without a judgement.

        Raises:
            TrainingError: a collapsed actor.
        """
        self._check_collapse(step, 1)

    def _check_collapse(self, step: int, fewest: int) -> None:
        if step < self.limits.grace:
            return
        if len(self.inside) >= fewest and _mean(self.inside) < self.limits.least_inside:
            raise TrainingError(
                f"step {step}: the actor has vanished (mean opacity {_mean(self.inside):.3f} on "
                f"the person over the last {len(self.inside)} steps, expected over "
                f"{self.limits.least_inside}); likely causes: too high a learning rate, empty or "
                "shifted masks, or fits that miss the person. The last good checkpoint is kept; "
                "look at the sample pictures, then begin a new run with a lower --rate-scale or "
                "another --seed."
            )
        if len(self.outside) >= fewest and _mean(self.outside) > self.limits.most_outside:
            raise TrainingError(
                f"step {step}: the body's box is filled with fog (mean opacity "
                f"{_mean(self.outside):.3f} beside the person over the last "
                f"{len(self.outside)} steps, expected under {self.limits.most_outside}); likely "
                "causes: masks that cover the background, or another background colour than the "
                "pictures'. The last good checkpoint is kept."
            )


def _mean(values: deque[float]) -> float:
    return sum(values) / len(values)
