import math
from dataclasses import dataclass

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.bounds import above, at_least, below


@dataclass(frozen=True)
class Options:
    max_frames: float | None = 2
    seeds: tuple[float, ...] = (2, 2)
    left_out: int | None = None


NAMES = ("max_frames", "seeds", "left_out")


def test_what_lies_inside_or_is_left_out_passes() -> None:
    at_least(2, Options(), *NAMES)
    above(1.5, Options(), *NAMES)
    below(2.5, Options(), *NAMES)


@pytest.mark.parametrize("value", [1, math.nan])
def test_what_lies_outside_is_named(value: float) -> None:
    options, others = Options(max_frames=value), Options(seeds=(2, value))
    with pytest.raises(UserError, match=rf"^--max-frames is {value:g}, expected at least 2\.$"):
        at_least(2, options, *NAMES)
    with pytest.raises(UserError, match=rf"^--max-frames is {value:g}, expected more than 1\.$"):
        above(1, options, *NAMES)
    with pytest.raises(UserError, match=rf"^--seeds is {value:g}, expected less than 1\.$"):
        below(1, Options(max_frames=0, seeds=(0, value)), *NAMES)
    with pytest.raises(UserError, match=rf"^--seeds is {value:g}, expected at least 2\.$"):
        at_least(2, others, *NAMES)
