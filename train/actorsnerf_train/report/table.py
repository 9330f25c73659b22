"""The report as `report.json` and `report.md`."""

import json
from collections.abc import Sequence
from pathlib import Path

from actorsnerf_train.checkpoint import write_whole
from actorsnerf_train.records import to_json_object
from actorsnerf_train.report.choice import LOSS, LPIPS_LOSS, NEAREST
from actorsnerf_train.report.errors import SAME
from actorsnerf_train.report.measure import Spread
from actorsnerf_train.report.rows import (
    ActorReport,
    LearningRow,
    PartRow,
    PointRow,
    SpeedReport,
    TrainingRow,
)
from actorsnerf_train.result import Json

SCHEMA = "actorsnerf-speed-report"
SCHEMA_VERSION = 1
JSON_NAME = "report.json"
MARKDOWN_NAME = "report.md"
PLOT_NAME = "pareto.png"


def write_tables(folder: Path, report: SpeedReport) -> Path:
    """The Markdown file, after the JSON beside it; each has its name only once it is complete."""
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Json] = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION}
    content = json.dumps(record | to_json_object(report), indent=1, allow_nan=False)
    write_whole(folder / JSON_NAME, (content + "\n").encode())
    path = folder / MARKDOWN_NAME
    write_whole(path, markdown(report).encode())
    return path


def markdown(report: SpeedReport) -> str:
    """The report for people."""
    machine = report.machine
    rates = ", ".join(f"{rate / 1e9:.0f} GFLOP/s {name}" for name, rate in report.gemm.items())
    lines = [
        "# Speed against error",
        "",
        f"{machine.processor} ({machine.device}), {machine.threads} of {machine.cores} cores, "
        f"torch {machine.torch}; products reach {rates}. Commit {report.commit or 'unknown'}, "
        f"seed {report.seed}, {report.rounds} rounds in turns; times are medians (quartiles) of "
        "one frame, its pose's own work included. The reference drew "
        f"{100 * report.reference_share:g} % of the rays in the body's box: its time is scaled up, "
        "and |Δrgb| and PSNR to it are over these pixels.",
        "",
    ]
    if report.lpips_note:
        lines += [f"LPIPS not computed: {report.lpips_note}", ""]
    for actor in report.actors:
        lines += _actor(actor)
    lines += _models(report.actors)
    return "\n".join(lines).rstrip("\n") + "\n"


def summary(report: SpeedReport) -> tuple[str, ...]:
    """A few lines for the terminal."""
    lines = []
    for actor in report.actors:
        named = {row.name: row for row in actor.points}
        best = named[actor.recommended]
        lines.append(
            f"{actor.actor}, {actor.method}: use {best.name} ({best.says}): "
            f"{_milliseconds(best.seconds)} ms a frame, {best.faster:.0f} times the "
            f"reference, {best.reference_psnr:.1f} dB to it"
        )
        useless = [row.name for row in actor.points if row.dominated_by is not None]
        lines.append(f"  nobody should use: {', '.join(useless) or 'none of them'}")
    return tuple(lines)


def _actor(actor: ActorReport) -> list[str]:
    width, height = actor.size
    return [
        f"## {actor.actor}: {actor.method} ({actor.preset} sizes, step {actor.step})",
        "",
        f"{len(actor.frames)} pictures of {width}x{height} ({'; '.join(actor.frames)}), "
        f"{actor.samples_per_ray} samples a ray, the person over {100 * actor.body_share:.1f} % of "
        f"the pixels; {actor.reference_pixels} pixels drawn by the reference. The actor: mean "
        f"opacity {actor.health.alpha_inside:.3f} on the person's pixels, {actor.health.psnr:.2f} "
        "dB to the true pictures in the box.",
        "",
        *_points(actor.points),
        "",
        f"**Use `{actor.recommended}`**: the fastest within {LOSS:g} dB and {LPIPS_LOSS:g} LPIPS "
        f"x1000 of `exact` and at least {NEAREST:g} dB to the reference picture.",
        "",
        *_useless(actor.points),
        *_scaling(actor),
        *_training(actor.training),
        *_learning(actor.learning),
        *_parts(actor.parts),
    ]


def _points(rows: tuple[PointRow, ...]) -> list[str]:
    lines = [
        "| point | what it does | ms a frame | x reference | samples with density, with colour | "
        "of the arithmetic limit | peak MB | PSNR | SSIM | LPIPS x1000 | dB to reference | mean, "
        "largest \\|Δrgb\\| x255 |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        largest = max(row.reference_largest, row.largest_anywhere or 0.0)
        same = row.kind != "reference" and largest <= SAME
        lines.append(
            f"| {'`' + row.name + '`'} | {row.says} | {_milliseconds(row.seconds)} "
            f"({_milliseconds(row.seconds_low)}-{_milliseconds(row.seconds_high)}) | "
            f"{row.faster:.1f} | {row.survivors:.0f}, {row.painted:.0f} of {row.samples:.0f} | "
            f"{_limit(row)} | {_or_dash(row.memory_mb, '.0f')} | {_or_dash(row.psnr, '.2f')} | "
            f"{_or_dash(row.ssim, '.4f')} | {_or_dash(row.lpips_x1000, '.2f')} | "
            f"{'-' if row.kind == 'reference' else format(row.reference_psnr, '.1f')} | "
            f"{255 * row.reference_mean:.3f}, {255 * largest:.2f}{' (exact)' if same else ''} |"
        )
    return lines


def _useless(rows: tuple[PointRow, ...]) -> list[str]:
    lines = [
        f"* `{row.name}`: `{row.dominated_by}` is no slower and no further from the reference."
        for row in rows
        if row.dominated_by is not None
    ]
    return ["Nobody should use:", "", *lines, ""] if lines else ["Every point has its use.", ""]


def _scaling(actor: ActorReport) -> list[str]:
    if not actor.scaling:
        return []
    lines = [
        "### What the time depends on",
        "",
        "The point `complete`, one frame; the cost follows the person's pixels and the samples on "
        "them, not the picture. Without some bones, the body parts that they hold are gone.",
        "",
        "| varied | to | ms a frame | rays | samples through networks |",
        "|---|---|---|---|---|",
    ]
    for row in actor.scaling:
        lines.append(
            f"| {row.what} | {row.value} | {_milliseconds(row.seconds)} | {row.rays} | "
            f"{row.survivors} |"
        )
    return [*lines, ""]


def _training(rows: tuple[TrainingRow, ...]) -> list[str]:
    if not rows:
        return []
    lines = [
        "### A training step",
        "",
        "Forward and backward on the same patches with the same losses; the reference renders "
        "patch by patch, adds the gradients up, and computes the actor's state once a step.",
        "",
        "| stage | patches | samples per ray | ms a step | reference, ms | x reference | loss | "
        "largest relative L2 error of a gradient |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row.stage} | {row.patches} of {row.side}x{row.side} | {row.samples_per_ray} | "
            f"{_spread(row.seconds)} | {_spread(row.reference_seconds)} | {row.faster:.1f} | "
            f"{row.loss_difference:.1e} | {row.gradient_error:.1e} ({row.worst_parameter}) |"
        )
    return [*lines, ""]


def _learning(rows: tuple[LearningRow, ...]) -> list[str]:
    if not rows:
        return []
    lines = [
        "### Time to a quality",
        "",
        "A few unseen pictures, measured as the actor was fitted (measuring is not counted); the "
        "reference's time is ours times the ratio of a few-shot step, above.",
        "",
        "| PSNR | step | s of training | reference, s |",
        "|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row.psnr:.2f} | {row.step} | {row.seconds:.0f} | "
            f"{_or_dash(row.reference_seconds, '.0f')} |"
        )
    return [*lines, ""]


def _parts(rows: tuple[PartRow, ...]) -> list[str]:
    if not rows:
        return []
    lines = [
        "### What each part of the model costs",
        "",
        "One frame, every sample in the shell, the same skinning volume, random weights. Only "
        "times: for what a part is worth in error, report trainings without it in the same run.",
        "",
        "| left out | ms a frame | MFLOP a sample, density + colour | samples through networks |",
        "|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row.without} | {_spread(row.seconds)} | {row.density_flops / 1e6:.3f} + "
            f"{row.colour_flops / 1e6:.3f} | "
            f"{row.survivors} |"
        )
    return [*lines, ""]


def _models(actors: Sequence[ActorReport]) -> list[str]:
    """The models of one actor beside each other, where several were measured."""
    groups: dict[tuple[str, str, tuple[str, ...]], list[ActorReport]] = {}
    for actor in actors:
        groups.setdefault((actor.actor, actor.data_sha256, actor.frames), []).append(actor)
    lines: list[str] = []
    for (name, _, _), mine in groups.items():
        if len(mine) > 1:
            lines += [
                f"## {name}: its models beside each other",
                "",
                "The point `exact` of each, on the same pictures; measured one model after the "
                "other, not in turns.",
                "",
                "| model | step | ms a frame | MFLOP a sample, density + colour | samples with "
                "density, with colour | opacity inside | PSNR | SSIM | LPIPS x1000 | recommended, "
                "ms |",
                "|---|---|---|---|---|---|---|---|---|---|",
                *map(_model, mine),
                "",
            ]
    return lines


def _model(actor: ActorReport) -> str:
    named = {row.name: row for row in actor.points}
    exact, best = named["exact"], named[actor.recommended]
    times = Spread(exact.seconds, exact.seconds_low, exact.seconds_high)
    return (
        f"| {actor.method} | {actor.step} | {_spread(times)} | "
        f"{exact.density_flops / 1e6:.3f} + {exact.colour_flops / 1e6:.3f} | "
        f"{exact.survivors:.0f}, {exact.painted:.0f} | {actor.health.alpha_inside:.3f} | "
        f"{_or_dash(exact.psnr, '.2f')} | {_or_dash(exact.ssim, '.4f')} | "
        f"{_or_dash(exact.lpips_x1000, '.2f')} | `{best.name}`, {_milliseconds(best.seconds)} |"
    )


def _spread(times: Spread) -> str:
    low, high = _milliseconds(times.low), _milliseconds(times.high)
    return f"{_milliseconds(times.median)} ({low}-{high})"


def _milliseconds(seconds: float) -> str:
    """With three digits at least.

    >>> _milliseconds(0.00123), _milliseconds(12.3)
    ('1.23', '12300')
    """
    value = 1e3 * seconds
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.0f}"


def _limit(row: PointRow) -> str:
    """A baked actor has no networks, so no such limit."""
    return f"{row.of_limit:.2f}" if row.density_flops > 0 else "-"


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


__all__ = ["JSON_NAME", "MARKDOWN_NAME", "PLOT_NAME", "markdown", "summary", "write_tables"]
