import json
import math
from dataclasses import replace
from pathlib import Path

from actorsnerf_train.machine import Machine
from actorsnerf_train.stability.case import Result, Row
from actorsnerf_train.stability.long import not_run
from actorsnerf_train.stability.round_trips import RegionError
from actorsnerf_train.stability.table import (
    JSON_NAME,
    StabilityReport,
    markdown,
    summary,
    write_report,
)

GOOD = Row(
    "ray",
    "in a face",
    "entry (m)",
    (
        Result("float64", None, None, True, 1e-9),
        Result("float32", 2e-6, 1e-7, True, 1e-5),
        Result("bfloat16", 0.0, None, True, None),
    ),
    1e-3,
    True,
    0.2,
    "",
)
BAD = replace(
    GOOD,
    name="at pi",
    results=(Result("float64", math.inf, None, False, 1e-9),),
    passed=False,
    strain=math.inf,
    note="why | not",
)
TRIP = RegionError("hands", 100, 0.002, 0.03, 0.4, 0.01, True, 7, 2e-7)
MACHINE = Machine("cpu", "a processor", 2, 1, "2", "Linux")


def report(*rows: Row, trip: RegionError = TRIP) -> StabilityReport:
    return StabilityReport("an actor", "abc", MACHINE, 12.0, rows, 5, (trip,), (trip,))


def test_a_row_of_the_table() -> None:
    text = markdown(report(GOOD))
    assert (
        "| ray: in a face | entry (m) | finite | 2.0e-06 (1e-05) | 0 | 1.0e-07 (0.001) | ok |"
    ) in text
    assert "1 cases and the warps of 5 random poses, all within their bounds" in text
    assert "Nearest to their bounds: **ray: in a face (2.0e-01 of its bound)**" in text


def test_a_failure_is_seen() -> None:
    made = report(GOOD, BAD)
    text = markdown(made)
    assert "**some out of bounds**" in text
    assert "| ray: at pi (why / not) | entry (m) | inf (1e-09) ! | - | - | - | **fails** |" in text
    assert "Nearest to their bounds: **ray: at pi" in text
    assert "  failed: ray: at pi (entry (m))" in summary(made)
    assert not made.passed


def test_regions_in_millimetres() -> None:
    expected = "| hands | 100 | 2.00 | 30.0 | 400 | 1.00 % | 7 | 2.0e-07 |"
    assert markdown(report(GOOD)).count(expected) == 2


def test_trips_are_judged() -> None:
    assert report(GOOD).passed
    assert not report(GOOD, trip=replace(TRIP, finite=False)).passed
    far = report(GOOD, trip=replace(TRIP, one_bone_largest=2e-5))
    assert not far.passed
    assert any("round trips" in line for line in summary(far))


def test_a_row_without_results_is_no_verdict() -> None:
    assert "| - | - | - | - | - |" in markdown(report(GOOD, not_run(2000)))


def test_the_files(tmp_path: Path) -> None:
    path = write_report(tmp_path / "new", report(GOOD, BAD))
    assert path.read_text().startswith("# Hard cases: an actor\n")
    record = json.loads((tmp_path / "new" / JSON_NAME).read_text())
    assert record["schema"] == "actorsnerf-stability"
    assert record["passed"] is False
    assert record["rows"][1]["results"][0]["error"] == "inf"
    assert record["trips"][0]["largest"] == 0.4
