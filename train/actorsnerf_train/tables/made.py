"""What was made already: finished runs, which must fit the plan, and recorded results."""

import json
from collections.abc import Sequence
from pathlib import Path

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.selection import FewshotChoice, find_protocol, find_shots
from actorsnerf_train.result import Evaluation
from actorsnerf_train.result_file import RESULT_NAME, read_result
from actorsnerf_train.run_folder import CONFIG
from actorsnerf_train.tables.entry import METHODS, PARTS, Entry
from actorsnerf_train.tables.options import ABLATED, TablesOptions
from actorsnerf_train.tables.plan import EVALUATION, Run

WHAT_NOW = "move its folder away to make it anew, or name another --out"


def refuse_other_runs(runs: Sequence[Run], options: TablesOptions) -> None:
    """Nothing, if the finished runs of a plan are what was asked for.

    Raises:
        UserError: one is of other data, or of another preset, list or number of steps.
    """
    digests = {path: SequenceFile(path).digest for run in runs for path in run.data}
    for run in runs:
        if run.status != "done":
            continue
        wanted = {digests[path] for path in run.data}
        if run.setting is None:
            _compare(run.folder / CONFIG, _seen(run.folder), wanted)
            continue
        path = run.folder / EVALUATION / RESULT_NAME
        result = read_result(path)
        _compare(path, {result.data_sha256}, wanted)
        found = (result.preset, result.step, result.list_name)
        asked = (options.preset, run.steps, options.list or result.list_name)
        if found != asked:
            raise UserError(
                f"{path}: is of the preset {found[0]}, {found[1]:,} steps and the {found[2]} list, "
                f"but {asked[0]}, {asked[1]:,} steps and the {asked[2]} list are asked: {WHAT_NOW}."
            )


def to_make(
    runs: Sequence[Run], recorded: Sequence[Entry], options: TablesOptions
) -> tuple[Run, ...]:
    """The runs of a plan but those that a recorded result stands for.

    A result stands for a run of the same method, actor, setting, list, seed, steps, preset and
    data digest. A category training that no run left begins from is left out as well.
    """
    known = {_key(entry.result, entry.label) for entry in recorded}
    fittings = [
        run
        for run in runs
        if run.setting is not None
        and (run.status == "done" or not known or _wanted_key(run, options) not in known)
    ]
    origins = {run.category for run in fittings if run.status != "done"}
    return tuple(
        run
        for run in runs
        if (run in fittings if run.setting is not None else run.folder in origins or not known)
    )


def row_label(run: Run) -> str:
    """The label that a run's evaluation will have in the tables."""
    name = METHODS["actorsnerf"]
    if run.method in ABLATED:
        return f"{name}, no {PARTS[ABLATED[run.method]]}"
    if run.method == "scratch":
        return f"{name}, from scratch"
    return METHODS[run.method]


Key = tuple[str, str, str | None, str | None, int, int, str, str]


def _key(result: Evaluation, label: str) -> Key:
    where = (label, result.actor, result.setting, result.list_name)
    return (*where, result.seed, result.step, result.preset, result.data_sha256)


def _wanted_key(run: Run, options: TablesOptions) -> Key:
    (path,) = run.data
    assert run.setting is not None
    with SequenceFile(path) as file:
        choice = FewshotChoice(run.setting, options.list)
        list_name = find_shots(file, find_protocol(file, None), choice).list_name
        where = (row_label(run), file.header.actor, run.setting, list_name)
        return (*where, run.seed, run.steps, options.preset, file.digest)


def _seen(run: Path) -> set[str]:
    """Digests of what a training read, or nothing where its `config.json` is gone."""
    path = run / CONFIG
    if not path.is_file():
        return set()
    return {digest for _, _, digest in json.loads(path.read_text(encoding="utf-8"))["data"]}


def _compare(path: Path, found: set[str], wanted: set[str]) -> None:
    if found and found != wanted:
        raise UserError(
            f"{path}: is of other data than --data names (digests {_short(found)} there, "
            f"{_short(wanted)} here): prepared anew since, or other actors? {WHAT_NOW}."
        )


def _short(digests: set[str]) -> str:
    return ", ".join(sorted(digest[:8] for digest in digests))
