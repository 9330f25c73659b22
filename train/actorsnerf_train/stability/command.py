"""The hard cases, tried on any checkpoint and any prepared file, or on an invented actor."""

import time
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from actorsnerf_train.bounds import at_least
from actorsnerf_train.config import PresetName
from actorsnerf_train.distributed import local_device
from actorsnerf_train.machine import program_commit, this_machine
from actorsnerf_train.stability.bench import Bench, make_bench
from actorsnerf_train.stability.case import Case, Row, judged
from actorsnerf_train.stability.cases_cull import cull_cases
from actorsnerf_train.stability.cases_input import input_cases
from actorsnerf_train.stability.cases_light import light_cases
from actorsnerf_train.stability.cases_motion import motion_cases
from actorsnerf_train.stability.cases_pictures import picture_cases
from actorsnerf_train.stability.cases_rays import ray_cases
from actorsnerf_train.stability.cases_skinning import skinning_cases
from actorsnerf_train.stability.cases_training import training_cases
from actorsnerf_train.stability.cases_views import view_cases
from actorsnerf_train.stability.long import LONG_STEPS, long_row, not_run
from actorsnerf_train.stability.round_trips import one_bone_volume, round_trips
from actorsnerf_train.stability.table import StabilityReport, summary, write_report

ONE_BONE_SHARE = 10
"""The one-bone volume is tried on every so many-th of the poses."""
LONG_FOLDER = "long"


class UnstableError(Exception):
    """A hard case is out of its bounds; the lines say which, and where the table is."""

    def __init__(self, lines: tuple[str, ...]) -> None:
        super().__init__("\n".join(lines))
        self.lines = lines


@dataclass(frozen=True)
class StabilityOptions:
    """Tries hard cases at float64, float32 and bfloat16 and writes a table of verdicts.

    Exit status 1 if one is out of its bounds. Minutes for a small model.
    """

    run: Path | None = None
    """Run folder or checkpoint of a pretrain or fewshot run; left out: an untrained method."""
    data: Path | None = None
    """Prepared file: its fastest frames are tried, and its support views where the checkpoint has
    none of its own; left out: an invented actor."""
    out: Path | None = None
    """Folder for stability.md and stability.json; left out: the run folder's `stability`, or
    `stability` here."""
    preset: PresetName = "small"
    """Sizes of the untrained method (without --run)."""
    poses: int = 10_000
    """Random dance-like poses to warp there and back."""
    long: bool = False
    """Also train in bfloat16 for --long-steps steps on the invented actor (hours for `small`)."""
    long_steps: int = LONG_STEPS
    """Length of the long run."""
    device: str = "cpu"
    """cpu, cuda, cuda:1, ..."""


def run_stability(options: StabilityOptions) -> tuple[str, ...]:
    """What to tell when every case is within its bounds, after the table was written.

    Raises:
        UnstableError: one is not; the table is written all the same.
        UserError: no such run or file, or one that cannot be used.
    """
    began = time.perf_counter()
    at_least(1, options, "poses", "long_steps")
    device = local_device(options.device)
    bench = make_bench(options.run, options.data, options.preset, device)
    folder = _folder(options)
    rows = judge_all(hard_cases(bench), bench)
    if options.long:
        rows += (long_row(bench.config, options.long_steps, folder / LONG_FOLDER, device),)
    else:
        rows += (not_run(options.long_steps),)
    subject = bench.subjects[1]
    body = subject.state.body
    joints, vertices = body.geometry.canonical_joints, body.geometry.rest_vertices
    threshold = subject.options.threshold
    fewer = max(options.poses // ONE_BONE_SHARE, 1)
    hard = one_bone_volume(body.skinning, joints)
    report = StabilityReport(
        title=bench.title,
        commit=program_commit(),
        machine=this_machine(device),
        poses=options.poses,
        rows=rows,
        trips=round_trips(body.skinning, joints, vertices, threshold, options.poses),
        one_bone_trips=round_trips(hard, joints, vertices, threshold, fewer),
        seconds=time.perf_counter() - began,
    )
    told = (*summary(report), f"table: {write_report(folder, report)}")
    if not report.passed:
        raise UnstableError(told)
    return told


def hard_cases(bench: Bench) -> list[Case]:
    """All cases, the geometry's first."""
    subject = bench.subjects[0]
    return [
        *motion_cases(subject),
        *skinning_cases(subject),
        *cull_cases(subject),
        *ray_cases(),
        *light_cases(),
        *view_cases(subject),
        *picture_cases(subject),
        *training_cases(),
        *input_cases(),
    ]


def judge_all(cases: list[Case], bench: Bench) -> tuple[Row, ...]:
    """The cases judged, one after the other."""
    bar = tqdm(cases, desc="hard cases", unit="case", leave=False)
    return tuple(judged(case, bench.subjects) for case in bar)


def _folder(options: StabilityOptions) -> Path:
    if options.out is not None:
        return options.out
    if options.run is None:
        return Path("stability")
    return (options.run if options.run.is_dir() else options.run.parent) / "stability"


__all__ = ["StabilityOptions", "UnstableError", "hard_cases", "judge_all", "run_stability"]
