"""What the report holds: plain numbers, as they stand in its JSON and its tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from actorsnerf_train.machine import Machine
from actorsnerf_train.report.choice import Standing, dominated, recommended
from actorsnerf_train.report.errors import Errors
from actorsnerf_train.report.frames import Health
from actorsnerf_train.report.measure import Measured, Spread
from actorsnerf_train.report.points import Kind


@dataclass(frozen=True)
class PointRow:
    """One operating point; times of one frame in seconds, work of one frame."""

    name: str
    says: str
    kind: Kind
    precision: str
    samples_per_ray: int
    threshold: float
    stop_transmittance: float
    seconds: float
    """Median over rounds."""
    seconds_low: float
    """First quartile."""
    seconds_high: float
    """Third quartile."""
    faster: float
    """Median time of the reference over this one's."""
    rays: float
    samples: float
    survivors: float
    """Samples that went through networks."""
    painted: float
    """Those whose colour was computed."""
    density_flops: float
    """Of the networks' matrix products, for one sample's density."""
    colour_flops: float
    """For its colour, in addition."""
    of_limit: float
    """Time that those products alone need at the rate measured in this run, over the time."""
    memory_mb: float | None
    """Peak of one frame beyond the loaded program; None: not measured."""
    psnr: float | None
    """To the true pictures, convention `box`, like the next two."""
    ssim: float | None
    lpips_x1000: float | None
    reference_psnr: float
    """To the reference picture inside the box, decibel."""
    reference_mean: float
    """Mean |difference of colours in [0, 1]|."""
    reference_largest: float
    """Largest on the pixels that the reference drew."""
    largest_anywhere: float | None
    """Largest over all pixels, measured to the `complete` picture."""
    dominated_by: str | None
    """A point that is no slower and no further from the reference; None: worth using."""


@dataclass(frozen=True)
class ScalingRow:
    """One frame at one size."""

    what: str
    """What is varied."""
    value: str
    """To what."""
    seconds: float
    rays: int
    survivors: int


@dataclass(frozen=True)
class TrainingRow:
    """One training step, ours and the reference's, on the same patches with the same losses."""

    stage: str
    patches: int
    side: int
    samples_per_ray: int
    seconds: Spread
    reference_seconds: Spread
    faster: float
    loss_difference: float
    """|difference| of the losses over the reference's."""
    gradient_error: float
    """Largest over the parameters: L2 norm of the difference over the reference's norm."""
    worst_parameter: str


@dataclass(frozen=True)
class LearningRow:
    """When the fitting reached a quality."""

    psnr: float
    """Of its curve's pictures, convention `box`."""
    step: int
    seconds: float
    """Of training."""
    reference_seconds: float | None
    """The same number of steps at the reference's pace."""


@dataclass(frozen=True)
class PartRow:
    """The model with a part left out; only its time, as its weights were trained with the part."""

    without: str
    seconds: Spread
    density_flops: float
    colour_flops: float
    survivors: int


@dataclass(frozen=True)
class ActorReport:
    """Everything about one checkpoint."""

    actor: str
    checkpoint: str
    data: str
    data_sha256: str
    method: str
    """With what was left out of it, as tables name it."""
    preset: str
    step: int
    size: tuple[int, int]
    """Width, height of the pictures."""
    samples_per_ray: int
    body_share: float
    """Of the picture, that the person covers, mean."""
    frames: tuple[str, ...]
    reference_pixels: int
    """Pixels that the reference drew, all frames together."""
    health: Health
    points: tuple[PointRow, ...]
    recommended: str
    scaling: tuple[ScalingRow, ...]
    training: tuple[TrainingRow, ...]
    learning: tuple[LearningRow, ...]
    """Empty for a run that was not measured as it learned."""
    parts: tuple[PartRow, ...]


@dataclass(frozen=True)
class SpeedReport:
    """The content of `report.json`."""

    commit: str | None
    machine: Machine
    seed: int
    rounds: int
    reference_share: float
    """Of the box's rays, that the reference drew."""
    gemm: Mapping[str, float]
    """Floating-point operations per second of a large product, by precision."""
    lpips_note: str | None
    time: str
    seconds: float
    actors: tuple[ActorReport, ...]


def point_rows(
    measured: Sequence[Measured], errors: Sequence[Errors], memory: Sequence[float | None]
) -> tuple[tuple[PointRow, ...], str]:
    """The rows, the reference first, and the name of the recommended point."""
    standings = [
        Standing(one.contestant.name, one.times, error.reference, error.truth)
        for one, error in zip(measured, errors, strict=True)
    ]
    worse = dominated(standings)
    slowest = measured[0].times.median
    rows = tuple(
        _row(one, error, peak, (slowest, worse.get(one.contestant.name)))
        for one, error, peak in zip(measured, errors, memory, strict=True)
    )
    return rows, recommended(standings)


def _row(
    one: Measured, error: Errors, memory: float | None, standing: tuple[float, str | None]
) -> PointRow:
    contestant, options, truth = one.contestant, one.contestant.actor.config.render, error.truth
    return PointRow(
        name=contestant.name,
        says=contestant.says,
        kind=contestant.kind,
        precision=contestant.precision,
        samples_per_ray=options.samples,
        threshold=options.threshold,
        stop_transmittance=options.stop_transmittance,
        seconds=one.times.median,
        seconds_low=one.times.low,
        seconds_high=one.times.high,
        faster=standing[0] / one.times.median,
        rays=one.rays,
        samples=one.samples,
        survivors=one.survivors,
        painted=one.painted,
        density_flops=one.flops.density,
        colour_flops=one.flops.colour,
        of_limit=one.of_limit,
        memory_mb=memory,
        psnr=None if truth is None else truth.psnr,
        ssim=None if truth is None else truth.ssim,
        lpips_x1000=None if truth is None else truth.lpips_x1000,
        reference_psnr=error.reference.psnr,
        reference_mean=error.reference.mean,
        reference_largest=error.reference.largest,
        largest_anywhere=error.reference.largest_anywhere,
        dominated_by=standing[1],
    )


__all__ = [
    "ActorReport",
    "LearningRow",
    "PartRow",
    "PointRow",
    "ScalingRow",
    "SpeedReport",
    "TrainingRow",
    "point_rows",
]
