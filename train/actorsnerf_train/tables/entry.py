"""Evaluations as entries of a table: whose row they belong to, and whether they may share one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.config import TrainConfig
from actorsnerf_train.labels import label_from, left_out
from actorsnerf_train.metrics import ConventionName
from actorsnerf_train.records import from_json, to_json
from actorsnerf_train.result import Evaluation, Json, MeanRow
from actorsnerf_train.result_file import RESULT_NAME, read_result
from actorsnerf_train.run_folder import first_difference


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
        try:
            return self.result.mean(convention)
        except UserError as error:
            raise UserError(f"{self.path}: {error}") from None


def label_of(result: Evaluation) -> str:
    """The row that an evaluation belongs to."""
    scratch = result.pretrained_from is None
    return label_from(result.method, left_out(result.configuration), scratch)


def reading_order(entry: Entry) -> tuple[bool, int, str, str]:
    """A sort key: settings by their shots, the short video last; then by list and label."""
    result = entry.result
    return (
        result.setting == "short-video",
        result.shots or 0,
        result.list_name or "",
        entry.label,
    )


def gather(places: Sequence[Path]) -> tuple[Entry, ...]:
    """The few-shot evaluations below some folders, in the order of their paths.

    Raises:
        UserError: there is none, or a place or a result cannot be read.
    """
    paths = sorted({path.resolve() for place in places for path in _results_below(place)})
    entries = without_copies(
        [Entry(path, result, label_of(result)) for path, result in _read(paths)]
    )
    if not entries:
        raise UserError(
            f"{', '.join(map(str, places))}: no result of a few-shot training ({RESULT_NAME}); "
            "make one: python -m actorsnerf_train evaluate --help"
        )
    return entries


def without_copies(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """The entries, a result that lies in several places once.

    Raises:
        UserError: two are of one row, setting, list, actor and seed, but not the same evaluation.
    """
    known: dict[tuple[object, ...], Entry] = {}
    for entry in entries:
        result = entry.result
        where = (result.setting, result.list_name, result.actor, result.seed)
        twin = known.setdefault((entry.label, *where), entry)
        if replace(twin.result, checkpoint="") != replace(result, checkpoint=""):
            raise UserError(
                f"{entry.path}: is of the same row ({entry.label}), setting, actor and seed as "
                f"{twin.path}, so it would count as one more seed: leave one of them out."
            )
    return tuple(known.values())


NOT_LEARNING = ("seed", "every", "health")
"""Of a configuration, what does not make two trainings differ but by chance."""
OF_PERSON = ("vertices", "frames")
"""Of a model, what follows from the person and the setting."""


def way_to_learn(result: Evaluation, where: Path) -> dict[str, Json]:
    """What all runs of a row share: everything of the configuration but chance, steps and person.

    A baseline that was tuned since, or that learned at another precision, is another baseline.
    """
    config = to_json(from_json(TrainConfig, result.configuration, f"{where}: configuration"))
    assert isinstance(config, dict)
    way = {key: value for key, value in config.items() if key not in NOT_LEARNING}
    for key, names in (("model", OF_PERSON), ("schedule", ("steps",))):
        part = way[key]
        assert isinstance(part, dict)
        way[key] = {name: value for name, value in part.items() if name not in names}
    return way | {
        "rendering": dict(result.render_options),
        "point": result.point,
        "baked": None if result.baked is None else result.baked.get("options"),
    }


def refuse_unequal(entries: Sequence[Entry]) -> None:
    """Nothing, if the entries may stand in one table.

    Raises:
        UserError: two of one actor measured different data, frames, cameras or backgrounds, two
            are of different data sets or presets, or two of one row learned in different ways.
    """
    first = entries[0]
    known: dict[str, Entry] = {}
    rows: dict[str, tuple[Entry, dict[str, Json]]] = {}
    for entry in entries:
        for name in ("dataset", "preset"):
            one, other = getattr(first.result, name), getattr(entry.result, name)
            if one != other:
                raise UserError(
                    f"{entry.path}: its {name} is {other}, that of {first.path} is {one}: one "
                    f"table has one; leave one of them out."
                )
        way = way_to_learn(entry.result, entry.path)
        row, shared = rows.setdefault(entry.label, (entry, way))
        difference = first_difference(shared, way, "")
        if difference:
            raise UserError(
                f"{entry.path}: differs from {row.path}, which is {entry.label} too "
                f"({difference}): one row has one way to learn and to draw; leave one of them out."
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
    if not place.is_dir():
        raise UserError(f"{place}: no such folder or result: correct the path.")
    return sorted(place.rglob(RESULT_NAME))


def _read(paths: Sequence[Path]) -> list[tuple[Path, Evaluation]]:
    results = [(path, read_result(path)) for path in paths]
    return [(path, result) for path, result in results if result.setting is not None]
