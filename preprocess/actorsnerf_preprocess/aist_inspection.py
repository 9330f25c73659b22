"""What can be said about an AIST++ sequence before any body model is needed."""

import hashlib
from dataclasses import dataclass

import numpy as np

from actorsnerf_datasets.types import Int64
from actorsnerf_preprocess.aist_annotations import (
    Motion,
    read_ignore_list,
    read_motion,
    read_setting,
)
from actorsnerf_preprocess.aist_checks import scaling_finding
from actorsnerf_preprocess.aist_names import video_name
from actorsnerf_preprocess.aist_tree import AistTree, find_tree
from actorsnerf_preprocess.aist_views import AistView, usable_views
from actorsnerf_preprocess.given_masks import GivenMasks, find_given_masks
from actorsnerf_preprocess.source import Finding, Found, OpenOptions, SourceError

PAPER_FIRST_FRAME = 200
PAPER_FRAME_STEP = 4
"""The published experiments use frames 200, 204, 208, ... (15 per second)."""
MIN_PAPER_FRAMES = 60
"""A motion that leaves fewer of those is prepared from its first frame."""


@dataclass(frozen=True)
class AistInspection:
    """All that can be said about a sequence without a body model."""

    tree: AistTree
    setting: str
    motion: Motion
    views: tuple[AistView, ...]
    given: tuple[GivenMasks | None, ...]
    frames: Int64
    """To be prepared, at 60 per second."""
    protocol_frames: Int64
    """Those of them that protocols choose from."""
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]


def inspect_aist(found: Found, options: OpenOptions) -> AistInspection:
    """Everything about a sequence but the fits.

    Raises:
        SourceError: an annotation file is missing or damaged, no view is usable, or the sequence is
            on the ignore list and not accepted.
    """
    tree = find_tree(found.path)
    if tree is None:
        raise SourceError(f"{found.path}: there are no AIST++ annotations below it.")
    findings = list(_ignore_findings(found.name, tree, options))
    motion = read_motion(tree.motions / f"{found.name}.pkl")
    setting, entries = read_setting(tree.cameras, found.name)
    views, remarks = usable_views(
        found.name, entries, tree.videos.get(found.name, {}), motion.scaling, len(motion.poses)
    )
    findings += [*scaling_finding(motion.scaling), *remarks]
    if not views:
        reasons = " ".join(f"{finding.entry}: {finding.sentence}" for finding in remarks)
        raise SourceError(f"{found.path}, {found.name}: no view is usable. {reasons}")
    covered = max(view.video.annotated_frames for view in views)
    length = min(len(motion.poses), covered)
    protocol_frames, frame_note = chosen_frames(length)
    frames = protocol_frames
    if options.pairs == "all":
        frames = np.arange(length, dtype=np.int64)
        frame_note = (
            f"All {length} frames (60 per second) are prepared, as asked for. The protocol keeps to"
            f" its own: {frame_note}"
        )
    masks = _given(found, options, views)
    notes = (
        *tree.notes,
        f"Lengths are divided by smpl_scaling {motion.scaling:.6g}: one metre is one metre of the"
        " SMPL body of zero betas; body, translation and cameras share it.",
        "Frame k is the picture shown at k/60 s by time stamps.",
        frame_note,
    )
    return AistInspection(
        tree=tree,
        setting=setting,
        motion=motion,
        views=views,
        given=masks,
        frames=frames,
        protocol_frames=protocol_frames,
        findings=tuple(findings),
        notes=notes,
    )


def chosen_frames(length: int) -> tuple[Int64, str]:
    """The frame numbers that protocols choose from of `length` frames, and a sentence on it."""
    paper = np.arange(PAPER_FIRST_FRAME, length, PAPER_FRAME_STEP, dtype=np.int64)
    if len(paper) >= MIN_PAPER_FRAMES:
        return paper, "Frames 200, 204, 208, ... (15 per second), as in the published experiments."
    step = PAPER_FRAME_STEP if length >= MIN_PAPER_FRAMES * PAPER_FRAME_STEP else 1
    chosen = np.arange(0, length, step, dtype=np.int64)
    return chosen, (
        f"Too short for frames 200, 204, ... of the published experiments ({length} frames); every"
        f" frame from 0 in steps of {step} is used."
    )


def _ignore_findings(sequence: str, tree: AistTree, options: OpenOptions) -> tuple[Finding, ...]:
    if sequence not in read_ignore_list(tree.ignore_list):
        return ()
    if options.ignored == "refuse":
        raise SourceError(
            f"{tree.ignore_list}: lists {sequence}; the authors of AIST++ found its fit wrong and"
            " ask to leave it out. Choose another sequence, or pass --accept-ignored."
        )
    sentence = f"{sequence} is on the ignore list of the data set and was accepted."
    return (Finding("warning", "ignore_list.txt", sentence),)


def _given(
    found: Found, options: OpenOptions, views: tuple[AistView, ...]
) -> tuple[GivenMasks | None, ...]:
    """The user's masks of each view."""
    masks = tuple(
        find_given_masks(
            options.masks,
            (
                video_name(found.name, view.camera.name),
                f"{found.name}/{view.camera.name}",
                view.camera.name,
            ),
            view.camera.size,
        )
        for view in views
    )
    if options.masks is not None and not any(masks):
        raise SourceError(
            f"{options.masks}: holds no masks of {found.name}; expected folders or videos called"
            f" {video_name(found.name, views[0].camera.name)}, or {found.name}/"
            f"{views[0].camera.name} with one picture per frame number."
        )
    return masks


def annotation_digests(found: Found, seen: AistInspection) -> tuple[tuple[str, str], ...]:
    """(path below the source folder, hex SHA-256) of the files that every sequence needs."""
    files = (
        seen.tree.cameras / "mapping.txt",
        seen.tree.cameras / f"{seen.setting}.json",
        seen.tree.motions / f"{found.name}.pkl",
    )
    return tuple(
        (path.relative_to(found.path).as_posix(), hashlib.sha256(path.read_bytes()).hexdigest())
        for path in files
    )


def mask_source(given: tuple[GivenMasks | None, ...], method: str) -> str:
    """What a prepared file records about where the masks of its views come from.

    Args:
        given: the masks of each view; None where they are made.
        method: how they are made.
    """
    if all(given):
        return "given by the user"
    if any(given):
        return f"given by the user for {sum(map(bool, given))} views; for the rest {method}"
    return method
