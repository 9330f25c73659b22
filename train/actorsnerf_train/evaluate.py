"""A protocol's unseen poses and views rendered and compared with the truth.

Pictures are compared whole: the truth is rebuilt from the stored crop on the background that the
method was trained with, and the prediction is rendered at the full picture's size.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import torch
from torch import Tensor
from tqdm import tqdm

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.selection import find_protocol
from actorsnerf_datasets.types import Protocol, UInt8
from actorsnerf_model.states import ActorState
from actorsnerf_train.bounds import at_least, below
from actorsnerf_train.checkpoint import FOLDER, write_whole
from actorsnerf_train.curve_file import read_curve
from actorsnerf_train.distributed import local_device
from actorsnerf_train.judge import Judged, Judgement, judge, strip_row
from actorsnerf_train.lpips import INSTALL, LpipsFiles, between, load_lpips
from actorsnerf_train.machine import program_commit, this_machine
from actorsnerf_train.methods import trunk_of
from actorsnerf_train.metrics import ConventionName, Lpips, Scores, mean_scores
from actorsnerf_train.pictures import STRIP_GAP, strip, strip_cell, write_png
from actorsnerf_train.places import find_places, spread
from actorsnerf_train.records import to_json
from actorsnerf_train.report.points import PointName, at_named_point
from actorsnerf_train.result import (
    CameraRow,
    CurvePoint,
    Evaluation,
    ImageRow,
    Json,
    MeanRow,
    StripLayout,
    StripRow,
)
from actorsnerf_train.result_file import RESULT_NAME, markdown, write_result
from actorsnerf_train.trained import TrainedActor, load_actor, with_samples

COLUMNS = ("truth", "prediction", "error")
"""Of the picture strip."""


@dataclass(frozen=True)
class EvaluateOptions:
    """Renders a protocol's evaluation frames and cameras and measures them."""

    checkpoint: Path
    """Few-shot run folder, one of its checkpoints, or a baked actor's file."""
    data: Path
    """Prepared file of the same actor."""
    out: Path
    """Folder for result.json, result.md and strip.png."""
    protocol: str | None = None
    """Named protocol of the file; by default the one of the few-shot training."""
    conventions: tuple[ConventionName, ...] = ("paper", "strict", "box")
    """What the pictures are compared on (see metrics.py)."""
    max_frames: int | None = None
    """For a quick look: at most this many frames, evenly spread; the result says so."""
    max_cameras: int | None = None
    """For a quick look: at most this many cameras, evenly spread; the result says so."""
    strip: int = 6
    """Rows (truth | prediction | error) of the picture strip; 0 writes none."""
    samples: int | None = None
    """Samples per ray; the training's own if left out."""
    point: PointName | None = None
    """Operating point, e.g. exact or fast (see `report`); left out: every sample that matters."""
    stop_transmittance: float | None = None
    """Stop a ray once less light than this passes; 0 = never; left out: as the point says."""
    lpips: LpipsFiles = field(default_factory=LpipsFiles)
    device: str = "cpu"
    """cpu, cuda, cuda:1, ..."""


@dataclass(frozen=True)
class EvaluationPlan:
    """Which pictures of a file a protocol evaluates."""

    protocol: Protocol
    frames: tuple[int, ...]
    """Frame numbers."""
    cameras: tuple[str, ...]
    limited: bool
    """Whether the protocol has more."""
    pairs: tuple[tuple[int, int], ...]
    """(camera, frame) positions with a valid picture."""
    missing: tuple[tuple[str, int], ...]
    """(camera, frame number) without."""


def run_evaluate(options: EvaluateOptions) -> Evaluation:
    """The evaluation, after result.json, result.md and strip.png were written to `options.out`.

    Raises:
        UserError: no such checkpoint, file or protocol; another actor; no evaluation picture.
    """
    _refuse_nonsense(options)
    trained = load_actor(options.checkpoint, local_device(options.device))
    trained = at_named_point(trained, options.point)
    with SequenceFile(options.data) as file:
        evaluation, rows = evaluate(trained, file, options)
    options.out.mkdir(parents=True, exist_ok=True)
    if rows:
        write_png(options.out / "strip.png", strip(rows))
    write_whole(options.out / "result.md", markdown(evaluation).encode())
    write_result(options.out / RESULT_NAME, evaluation)
    return evaluation


def _refuse_nonsense(options: EvaluateOptions) -> None:
    at_least(1, options, "max_frames", "max_cameras", "samples")
    at_least(0, options, "strip", "stop_transmittance")
    below(1, options, "stop_transmittance")


def evaluate(
    trained: TrainedActor[ActorState], file: SequenceFile, options: EvaluateOptions
) -> tuple[Evaluation, list[list[UInt8]]]:
    """The evaluation and the rows (truth, prediction, error) of its picture strip.

    Raises:
        UserError: another actor's file, no such protocol, or no picture to evaluate.
    """
    began = time.perf_counter()
    plan = plan_evaluation(trained, file, options)
    drawing = with_samples(trained.config.render, options.samples)
    if options.stop_transmittance is not None:
        drawing = replace(drawing, stop_transmittance=options.stop_transmittance)
    judgement = Judgement(
        options.conventions,
        drawing,
        published_lpips(options.lpips, trained.device),
    )
    shown = spread(plan.pairs, options.strip) if options.strip else []
    images: list[ImageRow] = []
    rows: list[list[UInt8]] = []
    for place in tqdm(plan.pairs, desc="evaluate", unit="picture"):
        judged = judge(trained, file, place, judgement)
        images += _image_rows(file, place, judged)
        if place in shown:
            rows.append(strip_row(file, place, judged))
    evaluation = _evaluation(trained, file, plan, judgement, images)
    seconds = time.perf_counter() - began
    strip_rows = _layout(file, shown, rows)
    return replace(evaluation, seconds=seconds, strip=strip_rows, point=options.point), rows


def plan_evaluation(
    trained: TrainedActor[ActorState], file: SequenceFile, options: EvaluateOptions
) -> EvaluationPlan:
    """Which pictures are to be evaluated.

    Raises:
        UserError: another actor's file, no such protocol, or no picture to evaluate.
    """
    header = file.header
    if not options.conventions:
        raise UserError("No convention is left to evaluate under: name one (paper, strict, box).")
    if header.actor != trained.actor:
        raise UserError(
            f"{file.path}: shows actor {header.actor}, but {trained.path} was fitted to "
            f"{trained.actor}: evaluate on that actor's file."
        )
    setting = trained.info.setting
    known = setting.protocol if setting is not None else None
    protocol = find_protocol(file, options.protocol or known)
    frames = spread(protocol.evaluation_frames, options.max_frames)
    cameras = spread(protocol.evaluation_cameras, options.max_cameras)
    places = find_places(file, protocol, frames, cameras)
    whole = (len(protocol.evaluation_frames), len(protocol.evaluation_cameras))
    limited = (len(frames), len(cameras)) != whole
    return EvaluationPlan(
        protocol, tuple(frames), tuple(cameras), limited, places.pairs, places.missing
    )


def _evaluation(
    trained: TrainedActor[ActorState],
    file: SequenceFile,
    plan: EvaluationPlan,
    judgement: Judgement,
    images: Sequence[ImageRow],
) -> Evaluation:
    header, info, config = file.header, trained.info, trained.config
    setting = info.setting
    return Evaluation(
        method=info.method if trained.baking is None else f"{info.method}-baked",
        preset=config.preset,
        actor=header.actor,
        sequence=header.sequence,
        dataset=header.provenance.dataset,
        data_sha256=file.digest,
        protocol=plan.protocol.name,
        setting=None if setting is None else setting.name,
        list_name=None if setting is None else setting.list_name,
        shots=None if setting is None else len(setting.frames),
        supports=trained.support_count,
        frames=plan.frames,
        cameras=plan.cameras,
        limited=plan.limited,
        missing=plan.missing,
        background=judgement.render.background,
        encoder=trunk_of(config),
        encoder_pretrained=info.origin.trunk_pretrained,
        pretrained_from=info.origin.category_digest,
        seed=config.seed,
        step=info.step,
        training_seconds=info.seconds,
        configuration=info.configuration,
        checkpoint=str(trained.path),
        render_options=_record(judgement.render),
        lpips_note=None if judgement.lpips else f"no LPIPS weights installed; {INSTALL}",
        machine=_record(this_machine(trained.device)),
        commit=program_commit(),
        time=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=0.0,
        render_seconds=_mean_seconds(images),
        means=_means(images, judgement.conventions),
        per_camera=_camera_means(images, plan.cameras, judgement.conventions),
        per_image=tuple(images),
        baked=None if trained.baking is None else _record(trained.baking),
        category_seconds=info.origin.category_seconds,
        curve=_curve(trained),
    )


def _curve(trained: TrainedActor[ActorState]) -> tuple[CurvePoint, ...] | None:
    """What was measured in the run folder that the checkpoint lies in."""
    folder = trained.path.parent
    if trained.baking is not None or folder.name != FOLDER:
        return None
    return read_curve(folder.parent, trained.info.step)


def _layout(
    file: SequenceFile, places: Sequence[tuple[int, int]], rows: Sequence[Sequence[UInt8]]
) -> StripLayout | None:
    if not rows:
        return None
    lines = []
    for (camera, frame), (truth, *_) in zip(places, rows, strict=True):
        height, width = truth.shape[:2]
        name, number = file.header.cameras[camera].name, int(file.header.frames[frame])
        lines.append(StripRow(name, number, width, height))
    return StripLayout(strip_cell(rows), STRIP_GAP, COLUMNS, tuple(lines))


def _image_rows(file: SequenceFile, place: tuple[int, int], judged: Judged) -> list[ImageRow]:
    camera, frame = place
    name, number = file.header.cameras[camera].name, int(file.header.frames[frame])
    return [
        ImageRow(name, number, convention, s.psnr, s.ssim, s.lpips_x1000, judged.seconds)
        for convention, s in judged.scores.items()
    ]


def _means(
    images: Sequence[ImageRow], conventions: Sequence[ConventionName]
) -> tuple[MeanRow, ...]:
    found = ((name, _mean(images, name)) for name in conventions)
    return tuple(MeanRow(name, s.psnr, s.ssim, s.lpips_x1000) for name, s in found)


def _camera_means(
    images: Sequence[ImageRow], cameras: Sequence[str], conventions: Sequence[ConventionName]
) -> tuple[CameraRow, ...]:
    rows: list[CameraRow] = []
    for camera in cameras:
        own = [row for row in images if row.camera == camera]
        for mean in _means(own, conventions) if own else ():
            rows.append(CameraRow(camera, mean.convention, mean.psnr, mean.ssim, mean.lpips_x1000))
    return tuple(rows)


def _mean(images: Sequence[ImageRow], convention: ConventionName) -> Scores:
    own = [row for row in images if row.convention == convention]
    return mean_scores([Scores(row.psnr, row.ssim, row.lpips_x1000) for row in own])


def _mean_seconds(images: Sequence[ImageRow]) -> float:
    by_picture = {(row.camera, row.frame): row.seconds for row in images}
    return sum(by_picture.values()) / len(by_picture)


def published_lpips(files: LpipsFiles, device: torch.device) -> Lpips | None:
    """The published distance of pictures in [0, 1], or None without weights."""
    network = load_lpips(files)
    if network is None:
        return None
    network.to(device)

    def distance(truth: Tensor, prediction: Tensor) -> Tensor:
        with torch.no_grad():
            return between(network, prediction.to(device), truth.to(device))

    return distance


def _record(value: object) -> dict[str, Json]:
    record = to_json(value)
    assert isinstance(record, dict)
    return record
