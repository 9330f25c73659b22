"""Learning rates and the opening of the deformation's encoding, as pure functions of the step.

The released code counts iterations; its constants (10,000, 50,000, 500,000) are iterations of that
count. A run here has its own number of steps and passes through a stretch of the official count at
its own pace, so the same constants hold in every preset: in `small` the deformation kicks in after
the same fraction of the run as in `official`.
"""

from dataclasses import dataclass

DECAY_BASE = 0.1
DECAY_COUNTS = 500_000
"""The rate falls to a tenth over this many counts (released code, `lrate_decay`)."""
KICK_IN = 10_000
"""The deformation is left out before this count (released code, `kick_in_iter`)."""
FULLY_OPEN = 50_000
"""Every band of its encoding is open from this count on (`full_band_iter`)."""


@dataclass(frozen=True)
class Schedule:
    """A run's steps, and the stretch of the official count that they pass through."""

    steps: int
    first_count: int = 0
    """Official count at step 0; few-shot fitting starts at 100,000 (released code)."""
    last_count: int = 200_000
    """Official count after the last step."""

    def __post_init__(self) -> None:
        if self.steps < 1 or not 0 <= self.first_count < self.last_count:
            raise ValueError(f"a schedule needs steps > 0 and 0 <= first < last count: {self}")


def count(schedule: Schedule, step: int) -> float:
    """The official count that a step stands for.

    >>> count(Schedule(steps=400), 20)
    10000.0
    """
    length = schedule.last_count - schedule.first_count
    return schedule.first_count + length * step / schedule.steps


def rate_factor(schedule: Schedule, step: int) -> float:
    """What every base rate is multiplied with at a step: 0.1^(count / 500,000).

    >>> round(rate_factor(Schedule(steps=10, first_count=100_000, last_count=400_000), 0), 3)
    0.631
    """
    return float(DECAY_BASE ** (count(schedule, step) / DECAY_COUNTS))


def open_bands(schedule: Schedule, step: int, bands: int) -> float:
    """How many bands of the deformation's encoding are open; 0 leaves the deformation out.

    Source: the Hann window of Nerfies; released code, alpha = bands max(t - 10k, 0) / 40k.

    >>> [open_bands(Schedule(steps=200), step, 6) for step in (0, 10, 30, 50, 200)]
    [0.0, 0.0, 3.0, 6.0, 6.0]
    """
    share = (count(schedule, step) - KICK_IN) / (FULLY_OPEN - KICK_IN)
    return bands * min(max(share, 0.0), 1.0)


def due(step: int, every: int, last: int) -> bool:
    """Whether something that happens every so many steps happens after this step.

    >>> [step for step in range(1, 8) if due(step, 3, 7)]
    [3, 6, 7]
    """
    return step == last or (every > 0 and step % every == 0)
