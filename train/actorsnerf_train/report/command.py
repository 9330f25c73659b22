"""The report's command: measure one or more fitted actors, write tables and plot."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Any

import torch
from tqdm import tqdm
from tyro.conf import Positional

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_train.bounds import at_least
from actorsnerf_train.distributed import local_device
from actorsnerf_train.evaluate import published_lpips
from actorsnerf_train.labels import label_from, left_out
from actorsnerf_train.lpips import INSTALL, LpipsFiles
from actorsnerf_train.machine import program_commit, this_machine
from actorsnerf_train.metrics import Lpips
from actorsnerf_train.options import ready_perceptual
from actorsnerf_train.report.contestants import chosen_points, contestants, refuse_strangers
from actorsnerf_train.report.errors import errors, health
from actorsnerf_train.report.frames import Frame, file_of, report_frames
from actorsnerf_train.report.learning import learning_rows
from actorsnerf_train.report.measure import Contestant, Effort, Measured, measure
from actorsnerf_train.report.memory import MemoryJob, peak_memory
from actorsnerf_train.report.plot import write_plot
from actorsnerf_train.report.points import OperatingPoint, PointName
from actorsnerf_train.report.rows import (
    ActorReport,
    PartRow,
    ScalingRow,
    SpeedReport,
    TrainingRow,
    point_rows,
)
from actorsnerf_train.report.scaling import part_rows, scaling_rows
from actorsnerf_train.report.table import PLOT_NAME, summary, write_tables
from actorsnerf_train.report.training import training_rows
from actorsnerf_train.trained import TrainedActor, load_baked, load_trained, resampled


@dataclass(frozen=True)
class ReportOptions:
    """Measures what each named saving costs in error and gains in time, and recommends one.

    Every operating point draws the same frames of the same actor in turns. Minutes for a small
    model; the reference draws a share of the rays, or it would take hours.
    """

    checkpoints: Positional[tuple[Path, ...]]
    """Few-shot run folders or checkpoints."""
    data: tuple[Path, ...]
    """Prepared files of the same actors: true pictures to compare with."""
    out: Path = Path("report")
    """Folder for report.json, report.md and pareto.png."""
    points: tuple[PointName, ...] = ()
    """Which operating points to measure beside reference, complete and exact; left out: all."""
    frames: int = 2
    """Frame numbers, evenly spread over the protocol's evaluation frames."""
    cameras: int = 1
    """Cameras, evenly spread over the protocol's evaluation cameras."""
    rounds: int = 5
    """How often each point is timed."""
    samples: int | None = None
    """Per ray; those of the fitting if left out."""
    reference_share: float = 0.05
    """Of the rays in the body's box, that the reference draws; 1 draws whole pictures."""
    baked: tuple[Path, ...] = ()
    """Baked files of the same actors, measured beside the operating points."""
    training: bool = True
    """Also time a step of both trainings against the reference's."""
    scaling: bool = True
    """Also time one frame in larger pictures, with more samples, and without parts of the model."""
    memory: bool = True
    """Also draw a frame of each point in a process of its own, for its peak memory."""
    seed: int = 0
    """Of the choice of reference rays and of training patches."""
    lpips: LpipsFiles = field(default_factory=LpipsFiles)
    """Your own files with the published LPIPS weights, where `make setup` could not get them."""
    device: str = "cpu"
    """cpu, cuda, cuda:1, ..."""


@dataclass(frozen=True)
class _Subject:
    """One actor to measure."""

    trained: TrainedActor[Any]
    data: Path
    frames: tuple[Frame, ...]
    digest: str


def run_report(options: ReportOptions) -> tuple[str, ...]:
    """What to tell, after report.json, report.md and pareto.png were written to `options.out`.

    Raises:
        UserError: no such checkpoint or file, one of another stage or actor, or no true picture.
    """
    began = time.perf_counter()
    _check(options)
    device = local_device(options.device)
    lpips = published_lpips(options.lpips, device)
    subjects = [_subject(checkpoint, options, device) for checkpoint in options.checkpoints]
    baked = [load_baked(path, device) for path in options.baked]
    refuse_strangers([subject.trained for subject in subjects], baked)
    reports: list[ActorReport] = []
    rates: dict[str, list[float]] = {}
    for subject in tqdm(subjects, desc="actors", unit="actor", leave=False):
        told, measured = _actor_report(subject, options, lpips)
        reports.append(told)
        for one in measured:
            rates.setdefault(one.contestant.precision, []).append(one.limit)
    report = SpeedReport(
        commit=program_commit(),
        machine=this_machine(device),
        seed=options.seed,
        rounds=options.rounds,
        reference_share=options.reference_share,
        gemm={precision: median(some) for precision, some in rates.items()},
        lpips_note=None if lpips else f"no LPIPS weights installed; {INSTALL}",
        time=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.perf_counter() - began,
        actors=tuple(reports),
    )
    table = write_tables(options.out, report)
    write_plot(options.out / PLOT_NAME, report)
    return (*summary(report), f"table: {table}", f"plot: {options.out / PLOT_NAME}")


def _check(options: ReportOptions) -> None:
    if not 0 < options.reference_share <= 1:
        raise UserError(
            f"--reference-share is {options.reference_share:g}, expected more than 0 and at most "
            "1: the share of the rays that the reference draws."
        )
    at_least(1, options, "frames", "cameras", "rounds", "samples")
    at_least(0, options, "seed")


def _subject(checkpoint: Path, options: ReportOptions, device: torch.device) -> _Subject:
    trained = resampled(load_trained(checkpoint, device), options.samples)
    path = file_of(trained.actor, options.data, checkpoint)
    with SequenceFile(path) as file:
        frames = report_frames(trained, file, options.frames, options.cameras)
        return _Subject(trained, path, frames, file.digest)


def _actor_report(
    subject: _Subject, options: ReportOptions, lpips: Lpips | None
) -> tuple[ActorReport, tuple[Measured, ...]]:
    trained, frames = subject.trained, subject.frames
    effort = Effort(options.rounds, options.reference_share, options.seed)
    points = chosen_points(options.points)
    drawing = contestants(trained, points, options.baked)
    measured = measure(drawing, frames, effort)
    found = errors(measured, frames, lpips)
    rows, best = point_rows(measured, found, _memory(subject, drawing, points, options))
    place = next(i for i, one in enumerate(drawing) if one.name == "complete")
    complete, rounds = drawing[place], options.rounds
    scaling: tuple[ScalingRow, ...] = ()
    parts: tuple[PartRow, ...] = ()
    steps: tuple[TrainingRow, ...] = ()
    if options.scaling:
        scaling = scaling_rows(complete, frames[0], rounds)
        parts = part_rows(trained, complete, frames[0], rounds)
    if options.training:
        perceptual = ready_perceptual(options.lpips).to(trained.device)
        steps = training_rows(trained, subject.data, perceptual, rounds, options.seed)
    report = ActorReport(
        actor=trained.actor,
        checkpoint=str(trained.path),
        data=str(subject.data),
        data_sha256=subject.digest,
        method=label_from(
            trained.info.method,
            left_out(trained.info.configuration),
            scratch=trained.info.origin.category_digest is None,
        ),
        preset=trained.config.preset,
        step=trained.info.step,
        size=frames[0].camera.size,
        samples_per_ray=trained.config.render.samples,
        body_share=sum(float(frame.mask.float().mean()) for frame in frames) / len(frames),
        frames=tuple(frame.name for frame in frames),
        reference_pixels=_reference_pixels(measured[0]),
        health=health(measured[place], found[place].truth, frames),
        points=rows,
        recommended=best,
        scaling=scaling,
        training=steps,
        learning=learning_rows(trained.path.parent.parent, trained.info.step, steps),
        parts=parts,
    )
    return report, measured


def _memory(
    subject: _Subject,
    drawing: Sequence[Contestant],
    points: Sequence[OperatingPoint],
    options: ReportOptions,
) -> tuple[float | None, ...]:
    """Of every contestant: the points first, then the baked files."""
    if not options.memory:
        return (None,) * len(drawing)
    effort = Effort(1, options.reference_share, options.seed)
    asked: list[OperatingPoint | None] = [*points]
    asked += [None] * (len(drawing) - len(points))
    threads = torch.get_num_threads()
    return peak_memory(
        [
            MemoryJob(
                one.actor.path,
                subject.data,
                point,
                None if point is None else options.samples,
                effort,
                threads,
                options.device,
            )
            for one, point in zip(drawing, asked, strict=True)
        ]
    )


def _reference_pixels(reference: Measured) -> int:
    return sum(drawn.pixels.shape[0] for drawn in reference.drawn if drawn.pixels is not None)


__all__ = ["ReportOptions", "run_report"]
