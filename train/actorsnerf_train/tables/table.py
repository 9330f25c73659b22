"""One table: methods by settings down, actors and their mean across, spread over seeds."""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from actorsnerf_train.metrics import ConventionName
from actorsnerf_train.result import MeanRow
from actorsnerf_train.tables.entry import Entry, reading_order

Budget = Literal["steps", "time"]
Measure = Callable[[Entry], MeanRow]
"""What counts of an evaluation."""
MEAN = "mean"
"""The column over all actors."""


@dataclass(frozen=True)
class Number:
    """A mean over seeds."""

    value: float
    spread: float | None
    """Sample standard deviation; None of a single seed."""


@dataclass(frozen=True)
class Cell:
    """What a method reaches on one actor, or on the mean of all."""

    psnr: Number
    ssim: Number
    lpips_x1000: Number | None
    seeds: int


@dataclass(frozen=True)
class Row:
    """A method in a setting."""

    label: str
    setting: str
    list_name: str
    cells: dict[str, Cell]
    """By actor, and `MEAN` where every actor of the table is there."""
    steps: tuple[int, ...]
    """Of the trainings; one number where they are equal, as they should be."""
    seconds: float
    """Median training time, category training not included."""
    category_seconds: float | None
    """Median of the category trainings that they began from; None: none, or not recorded."""
    budget: Budget = "steps"
    """What the rows of its setting have in common."""


@dataclass(frozen=True)
class Table:
    """All rows under one convention."""

    convention: ConventionName
    dataset: str
    preset: str
    actors: tuple[str, ...]
    rows: tuple[Row, ...]
    limited: bool = False
    """Whether only part of the protocol's pictures was evaluated."""


def make_table(
    entries: Sequence[Entry], convention: ConventionName, measure: Measure | None = None
) -> Table:
    """The table of entries that may share one.

    Args:
        entries: at least one.
        convention: of the pictures' comparison.
        measure: what to tabulate; left out: the means over all evaluated pictures.

    Raises:
        UserError: an entry lacks the convention.
    """
    measure = measure or (lambda entry: entry.mean(convention))
    actors = tuple(sorted({entry.result.actor for entry in entries}))
    groups: dict[tuple[str, str, str], list[Entry]] = {}
    for entry in sorted(entries, key=reading_order):
        result = entry.result
        key = (result.setting or "", result.list_name or "", entry.label)
        groups.setdefault(key, []).append(entry)
    rows = tuple(_row(key, mine, actors, measure) for key, mine in groups.items())
    first = entries[0].result
    limited = any(entry.result.limited for entry in entries)
    return Table(convention, first.dataset, first.preset, actors, rows, limited)


def _row(
    key: tuple[str, str, str],
    entries: Sequence[Entry],
    actors: tuple[str, ...],
    measure: Measure,
) -> Row:
    setting, list_name, label = key
    by_actor = {
        actor: [entry for entry in entries if entry.result.actor == actor] for actor in actors
    }
    cells = {
        actor: _cell([[entry] for entry in mine], measure)
        for actor, mine in by_actor.items()
        if mine
    }
    seeds = [{entry.result.seed for entry in mine} for mine in by_actor.values()]
    common = sorted(set.intersection(*seeds)) if seeds else []
    if common:
        runs = [[entry for entry in entries if entry.result.seed == seed] for seed in common]
        cells[MEAN] = _cell(runs, measure)
    waits = [entry.result.category_seconds for entry in entries]
    known = [seconds for seconds in waits if seconds is not None]
    return Row(
        label,
        setting,
        list_name,
        cells,
        tuple(sorted({entry.result.step for entry in entries})),
        statistics.median(entry.result.training_seconds for entry in entries),
        statistics.median(known) if known else None,
    )


def _cell(runs: Sequence[Sequence[Entry]], measure: Measure) -> Cell:
    """Over runs, each the mean of its entries (one, or one an actor)."""
    rows = [[measure(entry) for entry in run] for run in runs]
    distances = [[row.lpips_x1000 for row in run if row.lpips_x1000 is not None] for run in rows]
    measured = all(len(some) == len(run) for some, run in zip(distances, rows, strict=True))
    return Cell(
        _number([statistics.mean(row.psnr for row in run) for run in rows]),
        _number([statistics.mean(row.ssim for row in run) for run in rows]),
        _number([statistics.mean(run) for run in distances]) if measured else None,
        len(runs),
    )


def _number(values: Sequence[float]) -> Number:
    spread = statistics.stdev(values) if len(values) > 1 else None
    return Number(statistics.mean(values), spread)
