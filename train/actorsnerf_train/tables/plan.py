"""Which trainings and evaluations fill the tables of some prepared files, and how far they are."""

import json
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.selection import FewshotChoice, find_protocol, find_shots
from actorsnerf_train.checkpoint import FOLDER, LATEST, checkpoint_path
from actorsnerf_train.config import fewshot, pretraining
from actorsnerf_train.data_files import SUFFIX
from actorsnerf_train.result_file import RESULT_NAME
from actorsnerf_train.tables.options import ABLATED, WITHOUT_CATEGORY, MethodRow, TablesOptions

RUNS = "runs"
EVALUATION = "evaluation"
Status = Literal["done", "begun", "missing"]


@dataclass(frozen=True)
class Run:
    """One training, with its evaluation if it is a few-shot one."""

    folder: Path
    method: MethodRow
    data: tuple[Path, ...]
    """One held-out actor's file; of a category training, all training actors'."""
    setting: str | None
    """None: a category training."""
    seed: int
    steps: int

    @property
    def category(self) -> Path | None:
        """Folder of the category training that it begins from."""
        if self.setting is None or self.method in WITHOUT_CATEGORY:
            return None
        return category_folder(self.folder.parent, self.method)

    @property
    def status(self) -> Status:
        """How far it is."""
        if self.setting is not None and (self.folder / EVALUATION / RESULT_NAME).is_file():
            return "done"
        if self.setting is None and _steps_saved(self.folder) >= self.steps:
            return "done"
        return "begun" if self.folder.is_dir() else "missing"


def category_folder(out: Path, method: MethodRow) -> Path:
    """Where the category training of a method's row lies."""
    return out / (f"category-{method}" if method in ABLATED else "category")


def make_plan(options: TablesOptions) -> tuple[Run, ...]:
    """The runs that the options ask for, in the order in which they can be made.

    Raises:
        UserError: no training or no held-out actor, one who is both, or one whose sequence is too
            short for a setting.
    """
    training, held_out = _sorted_files(options.data)
    out = options.out / RUNS
    category_steps = options.pretrain_steps or pretraining(options.preset).schedule.steps
    steps = options.steps or fewshot(options.preset).schedule.steps
    runs = []
    for method in options.methods:
        if method in WITHOUT_CATEGORY:
            continue
        if not training:
            raise UserError(
                f"{', '.join(map(str, options.data))}: no file of a training actor, but the rows "
                f"{', '.join(options.methods)} need a category training: add files, or leave them "
                "out (--methods)."
            )
        folder = category_folder(out, method)
        runs.append(Run(folder, method, training, None, options.category_seed, category_steps))
    for seed in options.seeds:
        for setting in options.settings:
            for path, actor in held_out.items():
                for method in options.methods:
                    folder = out / f"{actor}-{setting}-{method}-seed{seed}"
                    runs.append(Run(folder, method, (path,), setting, seed, steps))
    for path in held_out:
        _refuse_missing_settings(path, options)
    return tuple(runs)


def hours_left(runs: Sequence[Run]) -> tuple[float, int]:
    """Hours that the missing runs will take, by the pace of those done, and how many have no pace.

    A run's pace is seconds a step of the finished runs of its method, category trainings apart.
    """
    paces: dict[tuple[str, bool], list[float]] = {}
    for run in runs:
        pace = _pace(run)
        if pace is not None:
            paces.setdefault((run.method, run.setting is None), []).append(pace)
    seconds, unknown = 0.0, 0
    for run in runs:
        if run.status == "done":
            continue
        known = paces.get((run.method, run.setting is None))
        if known is None:
            unknown += 1
        else:
            seconds += statistics.median(known) * max(run.steps - _steps_done(run.folder), 0)
    return seconds / 3600, unknown


def _sorted_files(files: Sequence[Path]) -> tuple[tuple[Path, ...], dict[Path, str]]:
    paths: list[Path] = []
    for file in files:
        paths += sorted(file.glob(f"*{SUFFIX}")) if file.is_dir() else [file]
    training: dict[Path, str] = {}
    held_out: dict[Path, str] = {}
    for path in paths:
        header = SequenceFile(path).header
        tested = any(protocol.role == "held_out" for protocol in header.protocols)
        (held_out if tested else training)[path] = header.actor
    if not held_out:
        raise UserError(
            f"{', '.join(map(str, files))}: no prepared file of a held-out actor, whom tables are "
            "about: prepare one (--held-out NAME), or name another folder."
        )
    for path, actor in held_out.items():
        seen = next((str(one) for one, name in training.items() if name == actor), None)
        if seen is not None:
            raise UserError(
                f"{path}: actor {actor} is held out here but a training actor in {seen}: figures "
                "on a known person mean nothing; leave one of the files out, or prepare both with "
                "--held-out."
            )
    for path, actor in held_out.items():
        other = next(one for one, name in held_out.items() if name == actor)
        if other != path:
            raise UserError(
                f"{path}: is of actor {actor}, like {other}: a table has one sequence of each held-"
                "out actor; name the files that you want, one each."
            )
    return tuple(training), held_out


def _refuse_missing_settings(path: Path, options: TablesOptions) -> None:
    with SequenceFile(path) as file:
        protocol = find_protocol(file, None)
        known = {shots.name for shots in protocol.shots}
        for setting in options.settings:
            if setting not in known:
                raise UserError(
                    f"{path}: actor {file.header.actor} has no setting {setting} in protocol "
                    f"{protocol.name}: its {len(file.header.frames)} frames are too few, or there "
                    f"is no such setting; there are {', '.join(sorted(known))}. Leave it out "
                    "(--settings), or prepare a longer sequence."
                )
            find_shots(file, protocol, FewshotChoice(setting, options.list))


def _steps_saved(folder: Path) -> int:
    """Of the latest checkpoint: the log may be ahead of it."""
    if not (folder / FOLDER / LATEST).is_file():
        return 0
    return int(checkpoint_path(folder).stem.removeprefix("step_"))


def _steps_done(folder: Path) -> int:
    trained = _trained(folder)
    return trained[0] if trained else 0


def _pace(run: Run) -> float | None:
    """Seconds a step, once a fifth of the run is behind it: first steps are slow."""
    trained = _trained(run.folder)
    if trained is None or trained[0] < run.steps / 5:
        return None
    return trained[1] / trained[0]


def _trained(folder: Path) -> tuple[int, float] | None:
    """Steps and seconds of a run so far, from its log; None if it has none."""
    path = folder / "log.jsonl"
    lines = path.read_text().splitlines() if path.is_file() else []
    whole = [line for line in lines if line.endswith("}")]  # a killed run ends within a line
    if not whole:
        return None
    entry = json.loads(whole[-1])
    return int(entry["step"]), float(entry["seconds"])
