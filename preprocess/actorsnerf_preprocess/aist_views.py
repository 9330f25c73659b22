"""The usable views of an AIST++ sequence: calibrated, filmed, and of one geometry."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.cameras import scaled_intrinsics
from actorsnerf_datasets.conventions import metres_from_aist
from actorsnerf_preprocess.aist_json import CameraEntry
from actorsnerf_preprocess.aist_names import CAMERA_NAMES, KNOWN_BAD_VIEWS
from actorsnerf_preprocess.aist_video import VideoFacts, probe_video
from actorsnerf_preprocess.source import Finding, SourceCamera, SourceError

LENGTH_TOLERANCE = 1
"""Annotated frames by which a video may differ from the motion without a word."""
_ASPECT_TOLERANCE = 0.01


@dataclass(frozen=True)
class AistView:
    """One view to read: its camera in metres and source pixels, and its video."""

    camera: SourceCamera
    video: VideoFacts


def usable_views(
    sequence: str,
    entries: tuple[CameraEntry, ...],
    videos: dict[str, Path],
    scaling: float,
    frame_count: int,
) -> tuple[tuple[AistView, ...], tuple[Finding, ...]]:
    """(views in the order of the annotations, what is wrong with them and with the rest).

    Left out, each with a finding: views without a video, videos that cannot be decoded, views
    that the data set's authors found bad, and pictures of another shape than was calibrated. A
    resized video (same shape) has its intrinsics resized.

    Args:
        sequence: its name.
        entries: the calibrated cameras.
        videos: file of each camera's name.
        scaling: world units per metre of the sequence.
        frame_count: of the motion, at 60 per second.
    """
    findings = [
        Finding("warning", name, f"{sequence} has no camera {name} in its setting.")
        for name in CAMERA_NAMES
        if name not in {entry.name for entry in entries}
    ]
    views = []
    for entry in entries:
        findings += _lens_findings(entry)
        try:
            view, remarks = _view(sequence, entry, videos.get(entry.name), scaling)
        except SourceError as error:
            findings.append(Finding("error", entry.name, f"{error} The view is left out."))
            continue
        findings += remarks
        if view is not None:
            findings += _length_findings(view, frame_count)
            views.append(view)
    return tuple(views), tuple(findings)


def _view(
    sequence: str, entry: CameraEntry, video: Path | None, scaling: float
) -> tuple[AistView | None, list[Finding]]:
    if video is None:
        return None, [
            Finding("warning", entry.name, "there is no video of this view; it is left out.")
        ]
    reason = KNOWN_BAD_VIEWS.get((sequence, entry.name))
    if reason is not None:
        return None, [Finding("warning", video.name, f"{reason}; the view is left out.")]
    facts = probe_video(video)
    factors = (facts.size[0] / entry.size[0], facts.size[1] / entry.size[1])
    if abs(factors[0] / factors[1] - 1.0) > _ASPECT_TOLERANCE:
        return None, [
            Finding(
                "error",
                video.name,
                f"is {facts.size[0]} x {facts.size[1]}, but {entry.size[0]} x {entry.size[1]} was"
                " calibrated, another shape; the view is left out.",
            )
        ]
    remarks = []
    if facts.size != entry.size:
        remarks.append(
            Finding(
                "note",
                video.name,
                f"is {facts.size[0]} x {facts.size[1]}, resized from {entry.size[0]} x"
                f" {entry.size[1]}; the intrinsics are resized with it.",
            )
        )
    camera = SourceCamera(
        name=entry.name,
        source_index=entry.index,
        K=scaled_intrinsics(entry.K, factors),
        distortion=entry.distortion,
        R=entry.R,
        T=metres_from_aist(entry.translation, scaling),
        size=facts.size,
    )
    return AistView(camera, facts), remarks


def _length_findings(view: AistView, frame_count: int) -> list[Finding]:
    covered = view.video.annotated_frames
    if abs(covered - frame_count) <= LENGTH_TOLERANCE:
        return []
    return [
        Finding(
            "warning",
            view.video.path.name,
            f"covers {covered} instants at 60 per second ({view.video.picture_count} pictures at"
            f" {view.video.rate:.3f}), the motion has {frame_count}; the shorter is used.",
        )
    ]


def _lens_findings(entry: CameraEntry) -> list[Finding]:
    """How the intrinsics depart from what the data set's calibration optimises."""
    remarks = []
    if not np.isclose(entry.K[0, 0], entry.K[1, 1]):
        remarks.append(f"fx {entry.K[0, 0]:g} and fy {entry.K[1, 1]:g} differ")
    centre = np.array(entry.size) / 2
    if not np.allclose(entry.K[:2, 2], centre):
        remarks.append(f"the centre is {entry.K[0, 2]:g}, {entry.K[1, 2]:g}")
    if np.any(entry.distortion[1:]):
        remarks.append("more than k1 of the distortion is set")
    if not remarks:
        return []
    sentence = f"{'; '.join(remarks)}: unusual for AIST++, used as found."
    return [Finding("note", entry.name, sentence)]
