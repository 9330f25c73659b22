import pytest

from actorsnerf_train.report.errors import errors
from actorsnerf_train.report.frames import Frame
from actorsnerf_train.report.measure import Measured
from actorsnerf_train.report.rows import point_rows


def test_rows_hold_what_was_measured(
    measured: tuple[Measured, ...], frames: tuple[Frame, ...]
) -> None:
    found = errors(measured, frames, None)
    memory = (1.0, 2.0, None, 4.0, 5.0)
    rows, best = point_rows(measured, found, memory)
    assert [row.name for row in rows] == [one.contestant.name for one in measured]
    assert best in {row.name for row in rows}
    for row, one, error, peak in zip(rows, measured, found, memory, strict=True):
        assert row.seconds == one.times.median and row.survivors == one.survivors
        assert row.faster == pytest.approx(measured[0].times.median / one.times.median)
        assert row.reference_largest == error.reference.largest
        assert row.memory_mb == peak
        assert row.samples_per_ray == (6 if row.name == "half-samples" else 12)
    assert rows[0].faster == 1.0
    assert rows[4].precision == "bfloat16"
    assert rows[0].dominated_by is not None  # all samples, no picture that anybody could tell apart
