"""Error against time: each method's mean curve, and the table at equal steps and at equal time.

Both budgets are read off the curves, so off the same few pictures. At equal time every method of a
setting has the training time of its quickest; between two points a curve is taken as straight.
"""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.result import CurvePoint, MeanRow
from actorsnerf_train.tables.entry import Entry, reading_order
from actorsnerf_train.tables.table import Row, Table, make_table

PLATEAU_SHARE = 0.2
"""Last part of the steps that is looked at for a plateau."""
PLATEAU_GAIN = 0.02
"""A curve has reached its plateau if that part lowered LPIPS by less than this share."""

Setting = tuple[str, str]
"""Name and list."""


@dataclass(frozen=True)
class Line:
    """The mean curve of a method in a setting, over actors and seeds."""

    label: str
    setting: Setting
    points: tuple[CurvePoint, ...]
    """Means at the steps that all its runs were measured at."""
    runs: int
    category_seconds: float | None

    @property
    def last_gain(self) -> float | None:
        """Share of LPIPS that the last fifth of the steps took away; None where none was measured.

        Negative where it rose.
        """
        end = self.points[-1]
        before = at_step(self.points, (1 - PLATEAU_SHARE) * end.step)
        if before.lpips_x1000 is None or end.lpips_x1000 is None:
            return None
        return 1 - end.lpips_x1000 / before.lpips_x1000


def measured(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Those with a curve.

    Raises:
        UserError: two of one actor were measured on other pictures or under other conventions.
    """
    found = [entry for entry in entries if entry.result.curve]
    mates: dict[str, Entry] = {}
    for entry in found:
        mate = mates.setdefault(entry.result.actor, entry)
        if {_way(point) for point in _curve(entry)} != {_way(_curve(mate)[0])}:
            raise UserError(
                f"{entry.path}: the curve of actor {entry.result.actor} was measured on other "
                f"pictures or under another convention than in {mate.path}: such curves cannot be "
                "compared; leave one of them out."
            )
    return tuple(found)


def make_lines(entries: Sequence[Entry]) -> tuple[Line, ...]:
    """The mean curve of every method in every setting, of measured entries; in reading order."""
    groups: dict[tuple[Setting, str], list[Entry]] = {}
    for entry in sorted(entries, key=reading_order):
        groups.setdefault((_setting(entry), entry.label), []).append(entry)
    return tuple(_line(label, setting, mine) for (setting, label), mine in groups.items())


def make_time_table(entries: Sequence[Entry]) -> Table:
    """The rows of every setting at equal steps, and again at the time of the quickest.

    Args:
        entries: measured, at least one.
    """
    lines = make_lines(entries)
    quickest = {
        setting: min(line.points[-1].seconds for line in lines if line.setting == setting)
        for setting in {line.setting for line in lines}
    }

    def last(entry: Entry) -> MeanRow:
        return _mean(_curve(entry)[-1])

    def at_quickest(entry: Entry) -> MeanRow:
        return _mean(at_time(_curve(entry), quickest[_setting(entry)]))

    convention = _curve(entries[0])[0].convention
    table = make_table(entries, convention, last)
    same_time = []
    for row in make_table(entries, convention, at_quickest).rows:
        setting = (row.setting, row.list_name)
        (line,) = (one for one in lines if (one.setting, one.label) == (setting, row.label))
        step = at_time(line.points, quickest[setting]).step
        row = replace(row, budget="time", seconds=quickest[setting], steps=(step,))
        same_time.append(row)
    return replace(table, rows=_side_by_side(table.rows, same_time))


def at_time(points: Sequence[CurvePoint], seconds: float) -> CurvePoint:
    """A curve's point after so much training; beyond its ends, the nearest end's figures."""
    return _between(points, [point.seconds for point in points], seconds)


def at_step(points: Sequence[CurvePoint], step: float) -> CurvePoint:
    """A curve's point after so many steps; beyond its ends, the nearest end's figures."""
    return _between(points, [float(point.step) for point in points], step)


def plateau_sentence(line: Line) -> str | None:
    """Whether a curve has reached its plateau; None without LPIPS."""
    gain = line.last_gain
    if gain is None:
        return None
    name = f"{line.label}, {line.setting[0]} ({line.setting[1]} list)"
    change = f"{'lowered' if gain >= 0 else 'raised'} LPIPS by {abs(gain):.1%}"
    span = f"the last {PLATEAU_SHARE:.0%} of {line.points[-1].step:,} steps {change}"
    if gain < PLATEAU_GAIN:
        return f"{name}: plateau reached ({span})."
    return f"{name}: **no plateau yet** ({span})."


def _between(points: Sequence[CurvePoint], places: Sequence[float], place: float) -> CurvePoint:
    if place <= places[0]:
        return points[0]
    if place >= places[-1]:
        return points[-1]
    after = next(i for i, one in enumerate(places) if one >= place)
    low, high = points[after - 1], points[after]
    share = (place - places[after - 1]) / (places[after] - places[after - 1])
    distance = None
    if low.lpips_x1000 is not None and high.lpips_x1000 is not None:
        distance = _mixed(low.lpips_x1000, high.lpips_x1000, share)
    return replace(
        low,
        step=round(_mixed(float(low.step), float(high.step), share)),
        seconds=_mixed(low.seconds, high.seconds, share),
        psnr=_mixed(low.psnr, high.psnr, share),
        ssim=_mixed(low.ssim, high.ssim, share),
        lpips_x1000=distance,
    )


def _mixed(low: float, high: float, share: float) -> float:
    return low + (high - low) * share


def _line(label: str, setting: Setting, entries: Sequence[Entry]) -> Line:
    curves = [{point.step: point for point in _curve(entry)} for entry in entries]
    common = sorted(set.intersection(*(set(curve) for curve in curves)))
    waits = [entry.result.category_seconds for entry in entries]
    known = [seconds for seconds in waits if seconds is not None]
    if not common:
        raise UserError(
            f"{label} in the setting {setting[0]}: its runs' curves have no step in common "
            f"({entries[0].path}, ...): were they trained for equal steps?"
        )
    points = tuple(_mean_point([curve[step] for curve in curves]) for step in common)
    return Line(label, setting, points, len(entries), statistics.median(known) if known else None)


def _mean_point(points: Sequence[CurvePoint]) -> CurvePoint:
    distances = [point.lpips_x1000 for point in points if point.lpips_x1000 is not None]
    return replace(
        points[0],
        seconds=statistics.mean(point.seconds for point in points),
        psnr=statistics.mean(point.psnr for point in points),
        ssim=statistics.mean(point.ssim for point in points),
        lpips_x1000=statistics.mean(distances) if len(distances) == len(points) else None,
        pictures=(),
    )


def _side_by_side(steps: Sequence[Row], time: Sequence[Row]) -> tuple[Row, ...]:
    """Of each setting the rows at equal steps, then those at equal time."""
    order = list(dict.fromkeys((row.setting, row.list_name) for row in steps))
    return tuple(
        row
        for setting in order
        for rows in (steps, time)
        for row in rows
        if (row.setting, row.list_name) == setting
    )


def _mean(point: CurvePoint) -> MeanRow:
    return MeanRow(point.convention, point.psnr, point.ssim, point.lpips_x1000)


def _way(point: CurvePoint) -> tuple[str, tuple[tuple[str, int], ...]]:
    return point.convention, point.pictures


def _setting(entry: Entry) -> Setting:
    return entry.result.setting or "", entry.result.list_name or ""


def _curve(entry: Entry) -> tuple[CurvePoint, ...]:
    assert entry.result.curve
    return entry.result.curve
