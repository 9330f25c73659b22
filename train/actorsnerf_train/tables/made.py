"""What was made already: finished runs, which must fit the plan, and recorded results."""

import json
from collections.abc import Sequence
from pathlib import Path

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.selection import FewshotChoice, find_protocol, find_shots
from actorsnerf_train.checkpoint import FOLDER, LATEST, load_info
from actorsnerf_train.config import TrainConfig, alone, fewshot
from actorsnerf_train.labels import label_from
from actorsnerf_train.records import from_json
from actorsnerf_train.result import Evaluation
from actorsnerf_train.result_file import RESULT_NAME, read_result
from actorsnerf_train.run_folder import CONFIG
from actorsnerf_train.tables.entry import Entry
from actorsnerf_train.tables.options import ABLATED, TablesOptions, method_of
from actorsnerf_train.tables.plan import EVALUATION, Run

WHAT_NOW = "move its folder away to make it anew, or name another --out"


def refuse_other_runs(runs: Sequence[Run], options: TablesOptions) -> None:
    """Nothing, if the finished runs of a plan are what was asked for.

    Raises:
        UserError: one is of other data, of another preset, list, seed, number of steps or of
            evaluated frames, or began from another category training.
    """
    digests = {path: SequenceFile(path).digest for run in runs for path in run.data}
    for run in runs:
        if run.status != "done":
            continue
        wanted = {digests[path] for path in run.data}
        if run.setting is None:
            _compare(run.folder / CONFIG, _seen(run.folder), wanted)
            _refuse_other_category(run, options)
            continue
        path = run.folder / EVALUATION / RESULT_NAME
        result = read_result(path)
        _compare(path, {result.data_sha256}, wanted)
        _refuse_other_fitting(path, run, result, options)


def _refuse_other_category(run: Run, options: TablesOptions) -> None:
    info = load_info(run.folder)
    where = f"{run.folder / CONFIG}: configuration"
    config = from_json(TrainConfig, info.configuration, where)
    found = (config.preset, info.step, config.seed)
    asked = (options.preset, run.steps, run.seed)
    if found != asked:
        keep = f"give --category-seed {found[2]}, or " if found[:2] == asked[:2] else ""
        raise UserError(
            f"{run.folder}: is of the preset {found[0]}, {found[1]:,} steps and seed {found[2]}, "
            f"but {asked[0]}, {asked[1]:,} steps and seed {asked[2]} are asked: {keep}"
            f"{WHAT_NOW}, and the fittings that began from it."
        )


def _refuse_other_fitting(path: Path, run: Run, result: Evaluation, options: TablesOptions) -> None:
    found = (result.preset, result.step, result.list_name)
    asked = (options.preset, run.steps, options.list or result.list_name)
    if found != asked:
        raise UserError(
            f"{path}: is of the preset {found[0]}, {found[1]:,} steps and the {found[2]} list, "
            f"but {asked[0]}, {asked[1]:,} steps and the {asked[2]} list are asked: {WHAT_NOW}."
        )
    frames = len(result.frames)
    if result.limited and (options.max_frames is None or frames < options.max_frames):
        raise UserError(
            f"{path}: only {frames} frames were evaluated, and more are asked: delete its folder "
            f"{EVALUATION}, so that the fitting is evaluated again, or give --max-frames {frames}."
        )
    category = run.category
    if category is None or not (category / FOLDER / LATEST).is_file():
        return
    if result.pretrained_from != load_info(category).tensors_sha256:
        raise UserError(
            f"{path}: began from another category training than {category} holds now: {WHAT_NOW}."
        )


def to_make(
    runs: Sequence[Run], recorded: Sequence[Entry], options: TablesOptions
) -> tuple[Run, ...]:
    """The runs of a plan but those that a recorded result stands for.

    A result stands for a run of the same method, actor, setting, list, seed, steps, preset, data
    digest and way to learn. A category training that no run left begins from is left out as well.
    """
    known = {_key(entry) for entry in recorded}
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
    without = (ABLATED[run.method],) if run.method in ABLATED else ()
    return label_from(method_of(run.method), without, run.category is None)


LEARNING = ("rates", "losses", "patches", "accumulation", "precision", "background")
"""Of a configuration, what a recorded result must share with the run that it stands for."""
Key = tuple[str, ...]


def _key(entry: Entry) -> Key:
    result = entry.result
    config = from_json(TrainConfig, result.configuration, f"{entry.path}: configuration")
    where = (entry.label, result.actor, str(result.setting), str(result.list_name))
    return (*where, *_how(config, result.seed, result.step), result.data_sha256)


def _wanted_key(run: Run, options: TablesOptions) -> Key:
    (path,) = run.data
    assert run.setting is not None
    preset, method = options.preset, method_of(run.method)
    alike = alone(method, preset) if run.category is None else fewshot(preset)
    with SequenceFile(path) as file:
        choice = FewshotChoice(run.setting, options.list)
        list_name = find_shots(file, find_protocol(file, None), choice).list_name
        where = (row_label(run), file.header.actor, run.setting, list_name)
        return (*where, *_how(alike, run.seed, run.steps), file.digest)


def _how(config: TrainConfig, seed: int, steps: int) -> Key:
    learning = [repr(getattr(config, name)) for name in LEARNING]
    return (config.preset, str(seed), str(steps), *learning)


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
