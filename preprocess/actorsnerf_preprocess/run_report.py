"""What a preparation did, for the user's screen and for a file beside the prepared one."""

import json
import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from actorsnerf_preprocess.picture_tasks import Outcome
from actorsnerf_preprocess.probes import Probe, area_jumps
from actorsnerf_preprocess.source import Finding, SourceError, SourceSequence

LOW_INSIDE = 0.9
"""A camera whose projected bodies lie less inside their masks than this is worth a look."""
CHECK_NOTICE = (
    "The readers of ZJU-MoCap and AIST++ were built to the documented formats and never run on an "
    "original archive; please run `python -m actorsnerf_datasets check` on the prepared file."
)


LIKELY_CAUSES = {
    "no mask": "put mask/ or mask_cihp/ of the archive beside the pictures, or pass --masks",
    "mask elsewhere": "do cameras, fits and pictures belong together, in their units and order?",
    "body outside the picture": "are cameras and fits those of these pictures, in their units?",
    "empty mask": "was the segmentation run on these pictures?",
    "empty stage where the body projects": "is this the video of this sequence and camera?",
    "missing": "were the pictures of this sequence downloaded?",
}
"""Why pictures may be unusable for a reason, or what to do."""


@dataclass(frozen=True)
class CameraReport:
    """One camera's share of a preparation."""

    name: str
    stored: int
    asked: int
    inside: float | None
    """Mean share of projected vertices inside the mask; None where none was seen."""


@dataclass(frozen=True)
class Unusable:
    """Pictures that are not stored, for one reason."""

    reason: str
    count: int
    example: str


@dataclass(frozen=True)
class Report:
    """What a preparation did."""

    sequence: str
    file: str
    settings: str
    """Digest of everything that decides the file's bytes; a later run skips when it is equal."""
    stored: int
    asked: int
    crop_size: tuple[int, int]
    bytes: int
    seconds: float
    cameras: tuple[CameraReport, ...]
    unusable: tuple[Unusable, ...]
    stray: int
    """Pictures whose mask has parts away from the body, outside the crop."""
    touching: int
    """Pictures whose alpha reaches the border of the crop inside the picture."""
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    notice: str = CHECK_NOTICE


@dataclass(frozen=True)
class Written:
    """A prepared file, as its report describes it."""

    path: Path
    settings: str
    crop_size: tuple[int, int]
    notes: tuple[str, ...]
    seconds: float


def lost_pictures(
    probes: Iterable[Probe], outcomes: Iterable[Outcome] = ()
) -> list[tuple[str, str]]:
    """(reason, file) of the pictures that are not stored: the first pass's, then the second's."""
    lost = [(probe.reason, probe.where) for probe in probes if probe.box is None]
    return lost + [(found.reason, found.where) for found in outcomes if found.stored is None]


def unusable_pictures(reasons: Iterable[tuple[str, str]]) -> tuple[Unusable, ...]:
    """Counts of (reason, file), the most frequent first, each with its first file.

    >>> unusable_pictures([("missing", "a.png"), ("missing", "b.png")])
    (Unusable(reason='missing', count=2, example='a.png'),)
    """
    listed = list(reasons)
    counts = Counter(reason for reason, _ in listed)
    first = {reason: where for reason, where in reversed(listed)}
    return tuple(Unusable(r, n, first[r]) for r, n in counts.most_common())


def picture_notes(probes: Sequence[Probe], outcomes: Sequence[Outcome]) -> list[str]:
    """What a prepared file says about its pictures and their masks."""
    unusable = unusable_pictures(lost_pictures(probes, outcomes))
    notes = [
        f"{one.count} of {len(probes)} pictures are not stored: {one.reason}." for one in unusable
    ]
    jumps = area_jumps(probes)
    if jumps:
        first = ", ".join(probe.where for probe in jumps[:3])
        notes.append(
            f"{len(jumps)} masks differ much in area from those of the frames around: {first}."
        )
    stray = sum(probe.stray for probe in probes)
    if stray:
        notes.append(f"{stray} masks have parts away from the body that the crops leave out.")
    return notes


def report_of(
    source: SourceSequence, probes: Sequence[Probe], outcomes: Sequence[Outcome], written: Written
) -> Report:
    """The report of a preparation.

    Args:
        source: what was prepared.
        probes: of the first pass.
        outcomes: of the second.
        written: the file.
    """
    kept = [outcome for outcome in outcomes if outcome.stored is not None]
    cameras = []
    for index, camera in enumerate(source.cameras):
        asked = [probe for probe in probes if probe.camera == index]
        seen: list[Probe | Outcome] = [*asked, *(o for o in outcomes if o.camera == index)]
        inside = [one.inside for one in seen if np.isfinite(one.inside)]
        stored = sum(outcome.camera == index for outcome in kept)
        mean = float(np.mean(inside)) if inside else None
        cameras.append(CameraReport(camera.name, stored, len(asked), mean))
    return Report(
        sequence=source.found.name,
        file=str(written.path),
        settings=written.settings,
        stored=len(kept),
        asked=len(probes),
        crop_size=written.crop_size,
        bytes=written.path.stat().st_size,
        seconds=written.seconds,
        cameras=tuple(cameras),
        unusable=unusable_pictures(lost_pictures(probes, outcomes)),
        stray=sum(probe.stray for probe in probes),
        touching=sum(outcome.touching for outcome in kept),
        findings=source.findings,
        notes=written.notes,
    )


def report_lines(report: Report) -> list[str]:
    """The report as the lines that a user reads."""
    rate = report.stored / report.seconds if report.seconds else 0.0
    lines = [
        f"{report.sequence}: {report.stored} of {report.asked} pictures stored in {report.file}",
        f"  crops of {report.crop_size[0]} x {report.crop_size[1]}, "
        f"{report.bytes / 1e6:.1f} MB, {report.seconds:.1f} s, {rate:.1f} pictures/s",
    ]
    for one in report.unusable:
        lines.append(f"  not stored: {one.count} x {one.reason}, for example {one.example}")
    for camera in report.cameras:
        if camera.inside is not None and camera.inside < LOW_INSIDE:
            lines.append(
                f"  {camera.name}: only {100 * camera.inside:.0f} % of the projected body lies "
                "inside the mask: is this camera calibrated for these pictures?"
            )
    if report.stray:
        lines.append(f"  {report.stray} masks have parts away from the body; those are cut off")
    if report.touching:
        lines.append(f"  {report.touching} silhouettes reach the border of their crop")
    shares = [camera.inside for camera in report.cameras if camera.inside is not None]
    if shares:
        lines.append(f"  projected body inside the mask: {100 * float(np.mean(shares)):.1f} %")
    return lines + [f"  note: {note}" for note in report.notes]


def finding_lines(findings: Iterable[Finding]) -> list[str]:
    """Findings as lines, the gravest first."""
    order = {"error": 0, "warning": 1, "note": 2}
    ranked = sorted(findings, key=lambda finding: order[finding.severity])
    return [f"  {f.severity}: {f.entry}: {f.sentence}" for f in ranked]


def write_report(path: Path, report: Report) -> None:
    """The report as JSON, complete or not at all.

    Raises:
        SourceError: the disk refuses.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("w") as file:
            json.dump(asdict(report), file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise SourceError(
            f"{path}: could not be written ({error}): is the disk full? Run the same command again."
        ) from error


def finished_settings(path: Path) -> str:
    """The settings digest of a written report; empty if there is none or it is damaged."""
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError):
        return ""
    settings = content.get("settings") if isinstance(content, dict) else None
    return settings if isinstance(settings, str) else ""
