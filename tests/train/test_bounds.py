import math

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.bounds import above, at_least, below


def test_what_lies_inside_or_is_left_out_passes() -> None:
    for value in (None, 2):
        at_least("steps", value, 2)
        above("fps", value, 1.5)
        below("elevation", value, 2.5)


@pytest.mark.parametrize("value", [1, math.nan])
def test_what_lies_outside_is_named(value: int | float) -> None:
    with pytest.raises(UserError, match=rf"--steps is {value:g}, expected at least 2\."):
        at_least("steps", value, 2)
    with pytest.raises(UserError, match=rf"--fps is {value:g}, expected more than 1\."):
        above("fps", value, 1)
    with pytest.raises(UserError, match=rf"--size is {value:g}, expected less than 1\."):
        below("size", value, 1)
