"""Evaluations as entries of a table: whose row they belong to, and whether they may share one."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.metrics import ConventionName
from actorsnerf_train.result import Evaluation, MeanRow
from actorsnerf_train.result_file import RESULT_NAME, read_result

PARTS = {
    "deformation": "deformation",
    "pixel_features": "pixel features",
    "body_features": "SMPL features",
}
"""Of ActorsNeRF, as its configuration and the paper name them."""
METHODS = {"actorsnerf": "ActorsNeRF", "humannerf": "HumanNeRF", "neuralbody": "Neural Body"}


@dataclass(frozen=True)
class Entry:
    """One evaluation."""

    path: Path
    result: Evaluation
    label: str
    """Row that it belongs to, e.g. "ActorsNeRF" or "ActorsNeRF, no deformation"."""

    def mean(self, convention: ConventionName) -> MeanRow:
        """The mean over all its pictures.

        Raises:
            UserError: it was not measured under that convention.
        """
        for row in self.result.means:
            if row.convention == convention:
                return row
        has = ", ".join(row.convention for row in self.result.means)
        raise UserError(
            f"{self.path}: has no figures under the convention {convention} (it has {has}); one "
            "table has one convention: choose another, or evaluate again."
        )


def label_of(result: Evaluation) -> str:
    """The row that an evaluation belongs to."""
    name = METHODS.get(result.method, result.method)
    if result.method != "actorsnerf":
        return name
    model = result.configuration.get("model")
    missing = [
        PARTS[part] for part in PARTS if isinstance(model, dict) and model.get(part) is False
    ]
    notes = [f"no {part}" for part in missing]
    if result.pretrained_from is None:
        notes.append("from scratch")
    return ", ".join([name, *notes])


def gather(places: Sequence[Path]) -> tuple[Entry, ...]:
    """The few-shot evaluations below some folders, in the order of their paths.

    Raises:
        UserError: there is none, or one cannot be read.
    """
    paths = sorted({path for place in places for path in _results_below(place)})
    entries = [Entry(path, result, label_of(result)) for path, result in _read(paths)]
    if not entries:
        raise UserError(
            f"{', '.join(map(str, places))}: no result of a few-shot training ({RESULT_NAME}); "
            "make one: python -m actorsnerf_train evaluate --help"
        )
    return tuple(entries)


LEARNING = ("rates", "losses", "patches")
"""Of a configuration, what all runs of a row share: a baseline tuned since is another baseline."""


def refuse_unequal(entries: Sequence[Entry]) -> None:
    """Nothing, if the entries may stand in one table.

    Raises:
        UserError: two of one actor measured different data, frames, cameras or backgrounds, two
            are of different data sets or presets, or two of one row learned in different ways.
    """
    first = entries[0]
    known: dict[str, Entry] = {}
    rows: dict[str, Entry] = {}
    for entry in entries:
        for name in ("dataset", "preset"):
            one, other = getattr(first.result, name), getattr(entry.result, name)
            if one != other:
                raise UserError(
                    f"{entry.path}: its {name} is {other}, that of {first.path} is {one}: one "
                    f"table has one; leave one of them out."
                )
        row = rows.setdefault(entry.label, entry)
        for name in LEARNING:
            if row.result.configuration.get(name) != entry.result.configuration.get(name):
                raise UserError(
                    f"{entry.path}: its {name} are not those of {row.path}, which is {entry.label} "
                    "too: one row has one way to learn; leave one of them out."
                )
        mate = known.setdefault(entry.result.actor, entry)
        for name in ("data_sha256", "frames", "cameras", "background"):
            if getattr(mate.result, name) != getattr(entry.result, name):
                raise UserError(
                    f"{entry.path}: actor {entry.result.actor} was measured on another {name} than "
                    f"in {mate.path}: such figures cannot be compared; evaluate one of them again."
                )


def _results_below(place: Path) -> list[Path]:
    if place.is_file():
        return [place]
    return sorted(place.rglob(RESULT_NAME))


def _read(paths: Sequence[Path]) -> list[tuple[Path, Evaluation]]:
    results = [(path, read_result(path)) for path in paths]
    return [(path, result) for path, result in results if result.setting is not None]
