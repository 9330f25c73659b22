"""The verdicts of the hard cases as Markdown and JSON."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

from actorsnerf_train.checkpoint import write_whole
from actorsnerf_train.machine import Machine
from actorsnerf_train.records import to_json
from actorsnerf_train.result import Json
from actorsnerf_train.stability.case import PRECISIONS, Result, Row
from actorsnerf_train.stability.round_trips import ONE_BONE_BOUND, RegionError

SCHEMA = "actorsnerf-stability"
MARKDOWN_NAME = "stability.md"
JSON_NAME = "stability.json"
HARDEST = 5
"""How many of the cases nearest to their bounds are named."""


@dataclass(frozen=True)
class StabilityReport:
    """What was tried on whom, and how it went."""

    title: str
    commit: str | None
    machine: Machine
    seconds: float
    rows: tuple[Row, ...]
    poses: int
    """Random poses of the round trips."""
    trips: tuple[RegionError, ...]
    """Through the subject's own skinning volume, float32."""
    one_bone_trips: tuple[RegionError, ...]
    """Through a volume in which each place belongs to one bone."""

    @property
    def failed(self) -> tuple[Row, ...]:
        """The rows out of their bounds."""
        return tuple(row for row in self.rows if not row.passed)

    @property
    def trips_hold(self) -> bool:
        """Every warp finite, and home within the bound where one bone acts."""
        return all(
            trip.finite and trip.one_bone_largest <= ONE_BONE_BOUND
            for trip in (*self.trips, *self.one_bone_trips)
        )

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return not self.failed and self.trips_hold


def write_report(folder: Path, report: StabilityReport) -> Path:
    """The Markdown file, after the JSON beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Json] = {"schema": SCHEMA, "schema_version": 1, "passed": report.passed}
    fields = to_json(report)
    assert isinstance(fields, dict)
    content = json.dumps(_without_infinity(record | fields), indent=1, allow_nan=False)
    write_whole(folder / JSON_NAME, (content + "\n").encode())
    path = folder / MARKDOWN_NAME
    write_whole(path, markdown(report).encode())
    return path


def markdown(report: StabilityReport) -> str:
    """The report for people."""
    verdict = "all within their bounds" if report.passed else "**some out of bounds**"
    lines = [
        f"# Hard cases: {report.title}",
        "",
        f"{len(report.rows)} cases and the warps of {report.poses} random poses, {verdict}; "
        f"{report.seconds:.0f} s on {report.machine.processor} ({report.machine.device}), commit "
        f"{report.commit or 'unknown'}.",
        "",
        "float64 is compared with an independent truth where there is one, else it is the truth. "
        "At bfloat16 the networks multiply in bfloat16, and everything, geometry too, runs inside "
        "autocast. Gradient: largest relative L2 error of a tensor at float32. A number in "
        "parentheses is the bound; `!` marks values or gradients that are not finite.",
        "",
        *_hardest(report),
        "",
        "| case | measured | float64 | float32 | bfloat16 | gradient | verdict |",
        "|---|---|---|---|---|---|---|",
        *(_line(row) for row in report.rows),
        "",
        f"## There and back: {report.poses} random dance-like poses, float32",
        "",
        "Canonical points warped to a pose and home again. Where bones blend, the paper's two "
        "warps are no inverses: the distance is recorded, not judged. Judged: every warp is "
        f"finite, and where one bone acts the way home ends within {ONE_BONE_BOUND:g} m.",
        "",
        *_trips(report.trips),
        "",
        "The same through a volume in which each place belongs to one bone:",
        "",
        *_trips(report.one_bone_trips),
    ]
    return "\n".join(lines) + "\n"


def summary(report: StabilityReport) -> tuple[str, ...]:
    """A few lines for the terminal."""
    lines = [f"{len(report.rows)} hard cases, {len(report.failed)} out of bounds"]
    lines += [f"  failed: {row.group}: {row.name} ({row.measured})" for row in report.failed]
    if not report.trips_hold:
        lines.append("  failed: round trips (not finite, or one bone's warp not inverted)")
    return (*lines, *(line.replace("**", "") for line in _hardest(report)))


def _hardest(report: StabilityReport) -> list[str]:
    ordered = sorted(report.rows, key=lambda row: (not row.passed, row.strain), reverse=True)
    named = [
        f"{row.group}: {row.name} ({_size(row.strain)} of its bound)" for row in ordered[:HARDEST]
    ]
    return [f"Nearest to their bounds: **{named[0]}**; {'; '.join(named[1:])}."] if named else []


def _line(row: Row) -> str:
    by_name = {result.precision: result for result in row.results}
    cells = [_cell(by_name.get(precision)) for precision in PRECISIONS]
    gradient = by_name["float32"].gradient_error if "float32" in by_name else None
    bounded = f" ({row.gradient_bound:g})" if row.gradient_bound is not None else ""
    told = "-" if gradient is None else f"{_size(gradient)}{bounded}"
    verdict = "**fails**" if not row.passed else "ok" if row.results else "-"
    note = f" ({row.note})" if row.note else ""
    name = f"{row.group}: {row.name}{note}".replace("|", "/")
    return f"| {name} | {row.measured} | {' | '.join(cells)} | {told} | {verdict} |"


def _cell(result: Result | None) -> str:
    if result is None:
        return "-"
    broken = "" if result.finite else " !"
    if result.error is None:
        return f"finite{broken}"
    bound = f" ({result.bound:.2g})" if result.bound is not None else ""
    return f"{_size(result.error)}{bound}{broken}"


def _trips(trips: tuple[RegionError, ...]) -> list[str]:
    lines = [
        "| region | trips | median (mm) | 95 % (mm) | largest (mm) | lost | one bone: trips | "
        "one bone: largest (m) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for trip in trips:
        alone = f"{trip.one_bone_largest:.1e}" if trip.one_bone_trips else "-"
        lines.append(
            f"| {trip.region} | {trip.trips} | {1e3 * trip.median:.2f} | {1e3 * trip.high:.1f} | "
            f"{1e3 * trip.largest:.0f} | {100 * trip.lost:.2f} % | {trip.one_bone_trips} | "
            f"{alone} |"
        )
    return lines


def _size(value: float) -> str:
    return "0" if value == 0 else f"{value:.1e}"


def _without_infinity(value: Json) -> Json:
    """JSON has no infinity: such a number becomes a string."""
    if isinstance(value, dict):
        return {key: _without_infinity(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_infinity(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


__all__ = [
    "JSON_NAME",
    "MARKDOWN_NAME",
    "StabilityReport",
    "markdown",
    "summary",
    "write_report",
]
