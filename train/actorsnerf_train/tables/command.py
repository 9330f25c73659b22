"""The `tables` command: plan the runs, make what is missing, write the tables."""

from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.bounds import at_least
from actorsnerf_train.checkpoint import write_whole
from actorsnerf_train.health import TrainingError
from actorsnerf_train.metrics import ConventionName
from actorsnerf_train.tables.curve_plot import write_curve_plot
from actorsnerf_train.tables.curves import (
    make_lines,
    make_time_table,
    measured,
)
from actorsnerf_train.tables.entry import Entry, gather, refuse_unequal
from actorsnerf_train.tables.execute import execute
from actorsnerf_train.tables.made import refuse_other_runs, to_make
from actorsnerf_train.tables.notes import COLLAPSED, collapses, table_notes, time_notes
from actorsnerf_train.tables.options import TablesOptions
from actorsnerf_train.tables.parts import part_gains, write_parts
from actorsnerf_train.tables.plan import Run, hours_left, make_plan
from actorsnerf_train.tables.plot import write_plot
from actorsnerf_train.tables.side_by_side import write_side_by_side
from actorsnerf_train.tables.table import make_table
from actorsnerf_train.tables.writing import write_table


def run_tables(options: TablesOptions) -> tuple[str, ...]:
    """What to tell: the plan, or the files written.

    Raises:
        UserError: files, settings or results are not as needed.
    """
    _refuse_nonsense(options)
    runs = _plan(options) if options.data else ()
    if options.dry_run:
        return describe_plan(runs)
    missing = [run for run in runs if run.status != "done"]
    if missing:
        tqdm.write("\n".join(describe_plan(runs)))
    lost = _make(missing, options)
    made = (options.out,) if options.out.is_dir() or not options.results else ()
    entries = gather((*made, *options.results))
    refuse_unequal(entries)
    options.out.mkdir(parents=True, exist_ok=True)
    told = [path for name in options.conventions for path in _write(options.out, entries, name)]
    told += _write_curves(options.out, entries)
    told += write_side_by_side(options.out, entries)
    return (*lost, *(f"table: {path}" for path in told))


def _refuse_nonsense(options: TablesOptions) -> None:
    for name in ("seeds", "methods", "settings", "conventions"):
        if not getattr(options, name):
            raise UserError(f"--{name} names nothing: give at least one, or leave it out.")
    at_least(1, options, "steps", "pretrain_steps", "max_frames")
    at_least(0, options, "seeds", "category_seed")


def _make(missing: Sequence[Run], options: TablesOptions) -> list[str]:
    """What to tell of the runs that collapsed; the others are made.

    Raises:
        TrainingError: a category training collapsed, from which others would begin.
    """
    lost = []
    for number, run in enumerate(missing, start=1):
        tqdm.write(f"\nrun {number} of {len(missing)}: {run.folder.name}")
        try:
            execute(run, options)
            (run.folder / COLLAPSED).unlink(missing_ok=True)
        except TrainingError as error:
            if run.setting is None:
                raise
            lost.append(f"not made: {run.folder.name}: {error}")
            run.folder.mkdir(parents=True, exist_ok=True)
            write_whole(run.folder / COLLAPSED, f"{error}\n".encode())
            tqdm.write(lost[-1])
    return lost


def _write(out: Path, entries: Sequence[Entry], convention: ConventionName) -> list[Path]:
    """The files under one convention: tables, plot, and what each part earns."""
    table = make_table(entries, convention)
    notes = (*table_notes(entries, table), *collapses(out))
    told = [*write_table(out, f"table_{convention}", table, notes)]
    plot, parts = out / f"lpips_{convention}.png", out / f"parts_{convention}.md"
    if write_plot(plot, table):
        told.append(plot)
    gains = part_gains(entries, convention)
    if gains:
        write_parts(parts, gains, convention)
        told.append(parts)
    return told


def _write_curves(out: Path, entries: Sequence[Entry]) -> list[Path]:
    """The files about error against time, of results that have curves."""
    curves = measured(entries)
    if not curves:
        return []
    table, lines = make_time_table(curves), make_lines(curves)
    told = [*write_table(out, "table_time", table, time_notes(curves, lines))]
    plot = out / "curves.png"
    if write_curve_plot(plot, lines):
        told.append(plot)
    return told


def _plan(options: TablesOptions) -> tuple[Run, ...]:
    """The runs, but those that recorded results stand for."""
    runs = make_plan(options)
    refuse_other_runs(runs, options)
    return to_make(runs, gather(options.results) if options.results else (), options)


def describe_plan(runs: Sequence[Run]) -> tuple[str, ...]:
    """One line a run, and the time left.

    Raises:
        UserError: there is nothing to plan.
    """
    if not runs:
        raise UserError(
            "no run is planned: --dry-run needs --data with prepared files, and some run that no "
            "result below --results stands for."
        )
    lines = [f"{run.status:8}{run.folder.name}  ({run.steps:,} steps)" for run in runs]
    hours, unknown = hours_left(runs)
    guess = f"about {hours:.1f} h left"
    if unknown:
        guess += f", not counting {unknown} runs of which no like one has been timed yet"
    return (*lines, guess)
