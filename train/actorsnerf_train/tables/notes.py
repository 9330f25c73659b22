"""The sentences below a table: what could bias its figures."""

from collections.abc import Sequence
from pathlib import Path

from actorsnerf_train.result import Evaluation
from actorsnerf_train.result_file import RESULT_NAME
from actorsnerf_train.tables.curves import Line, plateau_sentence
from actorsnerf_train.tables.entry import Entry
from actorsnerf_train.tables.table import Table

COLLAPSED = "collapsed.txt"
"""In the folder of a run that ended without a result: why."""


def table_notes(entries: Sequence[Entry], table: Table) -> tuple[str, ...]:
    """What could bias the figures, in sentences."""
    results = [entry.result for entry in entries]
    notes = [f"{len(entries)} results ({RESULT_NAME}), seeds {sorted({r.seed for r in results})}."]
    parts = sorted({(len(r.frames), len(r.cameras)) for r in results if r.limited})
    if parts:
        sizes = ", ".join(f"{frames} frames x {cameras} cameras" for frames, cameras in parts)
        notes.append(f"Only part of the protocol was evaluated: {sizes}.")
    notes += [*_absences(table), *_categories(entries)]
    uneven = [row for row in table.rows if len(row.steps) > 1]
    if uneven or len({row.steps for row in table.rows}) > 1:
        notes.append("**Not at equal steps**: see the column.")
    if any(r.pretrained_from for r in results):
        notes.append(
            "Training times leave out the category training, which is made once and stands beside "
            "('-': none, or not recorded)."
        )
    if any(r.curve for r in results):
        notes.append("At equal training time: table_time.md; error against time: curves.png.")
    notes.append(_machines(results))
    return tuple(notes)


def _absences(table: Table) -> list[str]:
    """Which rows lack actors, or have fewer seeds than others: a mean hides what collapsed."""
    notes = []
    for row in table.rows:
        name = f"{row.label}, {row.setting} ({row.list_name} list)"
        absent = [actor for actor in table.actors if actor not in row.cells]
        if absent:
            notes.append(f"**Missing actors**: {name} has no result of {', '.join(absent)}.")
        mates = [one for one in table.rows if one.setting == row.setting]
        most = max(cell.seeds for mate in mates for cell in mate.cells.values())
        few = [f"{actor} {cell.seeds}" for actor, cell in row.cells.items() if cell.seeds < most]
        if few:
            notes.append(f"**Missing seeds** (of {most}): {name} has of {', '.join(few)}.")
    return notes


def _categories(entries: Sequence[Entry]) -> list[str]:
    """Which rows began from more than one category training."""
    known: dict[str, set[str | None]] = {}
    for entry in entries:
        known.setdefault(entry.label, set()).add(entry.result.pretrained_from)
    return [
        f"**Several category trainings** ({len(digests)}) are behind {label}: their chance is in "
        "its spread, or in the difference of its settings."
        for label, digests in known.items()
        if len(digests) > 1
    ]


def collapses(out: Path) -> list[str]:
    """What is known of the fittings that collapsed."""
    return [
        f"**Not made**: {path.parent.name}: {path.read_text(encoding='utf-8').strip()}"
        for path in sorted(out.rglob(COLLAPSED))
    ]


def _machines(results: Sequence[Evaluation]) -> str:
    machines = {
        f"{r.machine.get('processor', '?')} ({r.machine.get('device', '?')})" for r in results
    }
    sentence = f"Machines: {', '.join(sorted(machines))}."
    return sentence if len(machines) == 1 else f"**Times of several machines.** {sentence}"


def time_notes(entries: Sequence[Entry], lines: Sequence[Line]) -> tuple[str, ...]:
    """How the table at equal time came about, and which curves still fall."""
    points = entries[0].result.curve or ()
    return (
        f"Read off the curves (curves.png) of {len(entries)} trainings, each the mean over "
        f"{len(points[0].pictures)} evaluation pictures of the actor; nothing was chosen by them. "
        "`time`: every method after the training time of the setting's quickest, interpolated; "
        "category training stands beside and is not in it.",
        _machines([entry.result for entry in entries]),
        *(sentence for line in lines if (sentence := plateau_sentence(line))),
    )
