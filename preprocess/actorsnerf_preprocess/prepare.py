"""A source sequence turned into a prepared file, in two passes over its pictures.

The first pass reads masks and finds each person's box; the largest gives the sequence's crop size.
Where masks are made, each camera's empty stage is estimated next. The second pass decodes,
undistorts, resizes, cuts and compresses in worker processes; this process only writes the chunks,
and last the protocols' lists, without the pictures that either pass lost.
Neither order nor bytes depend on the number of workers.
"""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from tqdm import tqdm

from actorsnerf_datasets.contact_sheet import write_contact_sheet
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import Provenance, SequenceHeader
from actorsnerf_datasets.writer import StoredPicture, write_sequence
from actorsnerf_preprocess.conclusion import concluded
from actorsnerf_preprocess.picture_tasks import (
    EncodeTask,
    Outcome,
    StageTask,
    encode_pictures,
    estimate_stage,
    probe_pictures,
)
from actorsnerf_preprocess.pictures import PictureOptions, stored_camera
from actorsnerf_preprocess.probes import Probe, crop_size, placed_crop
from actorsnerf_preprocess.process_team import ProcessTeam
from actorsnerf_preprocess.resume import pictures_digest, settings_digest
from actorsnerf_preprocess.run_report import (
    LIKELY_CAUSES,
    Report,
    Written,
    finished_settings,
    lost_pictures,
    report_of,
    unusable_pictures,
    write_report,
)
from actorsnerf_preprocess.sole_run import sole_run
from actorsnerf_preprocess.source import SourceError, SourceSequence, StageReader
from actorsnerf_preprocess.workers import (
    TASKS_AHEAD,
    Job,
    JobFile,
    PictureTask,
    in_order,
    job_file,
)

CONTENTS_PER_TASK = 32
"""Pictures that a task may return uncompressed: several tasks wait, each picture takes 0.3 MB."""


@dataclass(frozen=True)
class PrepareOptions:
    """How a sequence is prepared."""

    scale: float = 0.5
    """Stored size / source size; the published experiments use 0.5."""
    keep_background: bool = False
    workers: int = 1
    progress: bool = False
    contact_sheet: bool = True
    """Also draw `<name>.png`: frames by cameras with skeleton and mask outline."""


def prepare_sequence(
    source: SourceSequence, out: Path, options: PrepareOptions, executor: Executor | None = None
) -> Report | None:
    """Leaves `<out>/<name>.h5`, its report `<name>.json` and a contact sheet `<name>.png`.

    The report comes last; a run that finds it with the same settings does nothing.

    Args:
        source: the opened sequence.
        out: an existing folder.
        options: how.
        executor: runs the work (`workers.team`, or a cluster's); None: this process does.

    Returns:
        The report, or None if the file was there already.

    Raises:
        SourceError: no picture of the sequence is usable, another preparation is writing the same
            file, or the disk refuses.
        LayoutError: the file cannot be written.
    """
    started = time.perf_counter()
    path, report_path = out / f"{source.found.name}.h5", out / f"{source.found.name}.json"
    picture_options = PictureOptions(
        scale=options.scale,
        keep_background=options.keep_background,
        published_background=source.published_background,
    )
    settings = settings_digest(source, picture_options)
    if path.is_file() and finished_settings(report_path) == settings:
        return None
    with sole_run(path):
        report_path.unlink(missing_ok=True)
        job = Job(source, picture_options)
        with job_file(out / f"{source.found.name}.job.part", job) as file:
            passes = _Passes(source, file, options, executor)
            probes = passes.probe()
            plan = _plan(source, probes, picture_options)
            passes.estimate_stages(probes)
            outcomes: list[Outcome] = []
            pictures = passes.encode(probes, plan, outcomes)
            conclude = cache(lambda: concluded(source, probes, outcomes, options.scale))
            write_sequence(path, plan.header, plan.crop_size, pictures, conclude)
        seconds = time.perf_counter() - started
        written = Written(path, settings, plan.crop_size, conclude().notes, seconds)
        report = report_of(source, probes, outcomes, written)
        if options.contact_sheet:
            with SequenceFile(path) as sequence:
                write_contact_sheet(sequence, out / f"{source.found.name}.png")
        write_report(report_path, report)
    return report


@dataclass(frozen=True)
class _Plan:
    """What is known before any image is decoded."""

    header: SequenceHeader
    """With the source's protocols and notes, which what becomes of the pictures may change."""
    crop_size: tuple[int, int]


class _Passes:
    """The two passes over a sequence's pictures, camera by camera, frames ascending."""

    def __init__(
        self,
        source: SourceSequence,
        file: JobFile,
        options: PrepareOptions,
        executor: Executor | None,
    ) -> None:
        self._source = source
        self._file = file
        self._executor = executor
        # Passing on costs less than unpacking within this machine, if memory holds the results.
        self._with_content = source.reader.frames_per_task <= CONTENTS_PER_TASK and (
            executor is None or isinstance(executor, ProcessTeam)
        )
        self._ahead = TASKS_AHEAD * max(options.workers, 1)
        self._progress = options.progress

    def probe(self) -> list[Probe]:
        wanted = [np.flatnonzero(row).tolist() for row in self._source.wanted]
        tasks = list(self._tasks(wanted))
        with self._bar("masks", sum(map(len, wanted))) as bar:
            probes: list[Probe] = []
            for group in in_order(self._executor, probe_pictures, tasks, self._ahead):
                probes.extend(group)
                bar.update(len(group))
        return probes

    def estimate_stages(self, probes: Sequence[Probe]) -> None:
        """The cameras' empty stages, where masks are made: once each, not once per process."""
        reader = self._source.reader
        if not isinstance(reader, StageReader):
            return
        cameras = sorted({probe.camera for probe in probes if probe.box})
        tasks = [StageTask(self._file, each) for each in cameras if reader.needs_stage(each)]
        with self._bar("stages", len(tasks)) as bar:
            for _ in in_order(self._executor, estimate_stage, tasks, self._ahead):
                bar.update()

    def encode(
        self, probes: Sequence[Probe], plan: _Plan, outcomes: list[Outcome]
    ) -> Iterator[StoredPicture]:
        """The pictures to write; what became of each is appended to `outcomes`.

        Raises:
            SourceError: there is none.
        """
        crops = {(p.camera, p.frame): placed_crop(p.box, plan.crop_size) for p in probes if p.box}
        masks = {(p.camera, p.frame): p.packed for p in probes}
        unseen = {probe.camera for probe in probes if probe.box and np.isnan(probe.inside)}
        frames = [
            sorted(f for c, f in crops if c == camera)
            for camera in range(len(self._source.cameras))
        ]
        tasks = [
            EncodeTask(
                task,
                tuple(crops[task.camera, frame] for frame in task.frames),
                judge=task.camera in unseen,
                masks=tuple(masks[task.camera, frame] for frame in task.frames),
                with_content=self._with_content,
            )
            for task in self._tasks(frames)
        ]
        with self._bar("pictures", len(crops)) as bar:
            for group in in_order(self._executor, encode_pictures, tasks, self._ahead):
                for outcome in group:
                    stored = outcome.stored
                    if stored is not None:
                        yield stored
                    outcomes.append(_without_bytes(outcome))
                bar.update(len(group))
        if not any(outcome.stored for outcome in outcomes):
            raise _nothing_usable(self._source, lost_pictures(probes, outcomes))

    def _tasks(self, frames_per_camera: Sequence[Sequence[int]]) -> Iterator[PictureTask]:
        step = self._source.reader.frames_per_task
        for camera, frames in enumerate(frames_per_camera):
            for start in range(0, len(frames), step):
                yield PictureTask(self._file, camera, tuple(frames[start : start + step]))

    def _bar(self, what: str, total: int) -> "tqdm[None]":
        return tqdm(
            total=total,
            desc=f"{self._source.found.name} {what}",
            unit=what.removesuffix("s"),
            disable=not self._progress,
        )


def _without_bytes(outcome: Outcome) -> Outcome:
    """The outcome without its chunks, which are written by now."""
    if outcome.stored is None:
        return outcome
    place = (outcome.camera, outcome.frame)
    kept = StoredPicture(*place, outcome.stored.offset, b"", b"")
    return replace(outcome, stored=kept)


def _nothing_usable(source: SourceSequence, lost: Sequence[tuple[str, str]]) -> SourceError:
    reasons = unusable_pictures(lost)
    listed = "; ".join(f"{one.count} x {one.reason} ({one.example})" for one in reasons)
    cause = LIKELY_CAUSES.get(reasons[0].reason, "look at that file")
    return SourceError(
        f"{source.found.path}: none of the {len(lost)} pictures asked for is usable: {listed}:"
        f" {cause}"
    )


def _plan(source: SourceSequence, probes: Sequence[Probe], options: PictureOptions) -> _Plan:
    if not any(probe.box for probe in probes):
        raise _nothing_usable(source, lost_pictures(probes))
    return _Plan(
        _header(source, probes, options),
        crop_size(probe.box for probe in probes if probe.box),
    )


def _header(
    source: SourceSequence, probes: Sequence[Probe], options: PictureOptions
) -> SequenceHeader:
    digest = pictures_digest(probe.digest for probe in probes)
    digests = source.source_digests
    if digest:
        digests = (*digests, (f"({len(probes)} pictures with their masks)", digest))
    return SequenceHeader(
        sequence=source.found.name,
        actor=source.actor,
        world_up=source.world_up,
        cameras=tuple(stored_camera(camera, options.scale) for camera in source.cameras),
        frames=source.frames,
        fits=source.fits,
        shape=source.shape,
        protocols=source.protocols,
        provenance=Provenance(
            dataset=source.found.dataset,
            variant=source.found.variant,
            body_model=source.body_model,
            scale=options.scale,
            background="kept" if options.keep_background else "dropped",
            mask_source=source.mask_source,
            source_terms=source.source_terms,
            notes=source.notes,
            source_digests=digests,
        ),
    )
