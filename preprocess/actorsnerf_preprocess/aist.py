"""AIST++ as preparation sees it: annotations and videos, in metres and the standard convention.

Built to the documented format: annotations of the release of March 2021, videos of the AIST Dance
Video Database at 60 pictures per second. What differs from the released ActorsNeRF preparation:
the body turns about the pelvis, frames are found by time and not by counting, pictures are
undistorted, and the rest pose comes from the model that the fits were made with (male).
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets import protocols
from actorsnerf_datasets.body_model import BodyModel, load_body_model
from actorsnerf_datasets.published import AIST_SEQUENCES
from actorsnerf_datasets.types import BodyFits, Int64, Protocol, Role
from actorsnerf_preprocess.aist_annotations import (
    read_keypoints,
)
from actorsnerf_preprocess.aist_checks import (
    keypoint_findings,
    require_plausible_distance,
    swapped_sides_finding,
)
from actorsnerf_preprocess.aist_fits import fits_of_motion, world_joints
from actorsnerf_preprocess.aist_inspection import (
    AistInspection,
    annotation_digests,
    inspect_aist,
    mask_source,
)
from actorsnerf_preprocess.aist_names import CAMERA_NAMES, dancer_of
from actorsnerf_preprocess.aist_reader import AistReader, AistScene
from actorsnerf_preprocess.aist_tree import find_tree
from actorsnerf_preprocess.free_body import FREE_BODY_NAME, free_body
from actorsnerf_preprocess.held_out import held_out_warning
from actorsnerf_preprocess.masks import METHOD
from actorsnerf_preprocess.segmenter import tried_segmenter
from actorsnerf_preprocess.source import (
    Finding,
    Found,
    OpenOptions,
    SourceError,
    SourceSequence,
    Survey,
)

WORLD_UP = (0.0, 1.0, 0.0)
SOURCE_TERMS = (
    "redistribution = not allowed (AIST Dance Video Database terms of use); annotations CC BY 4.0;"
    " body model under its own licence"
)
SYNTHETIC_TERMS = "redistribution = allowed (CC0 body, generated videos)"
SYNTHETIC_SIGN = "synthetic.json"
"""A file of this name at the root marks a tree written by our own generator."""


def find_aist(root: Path, unfilmed: bool = False) -> tuple[Found, ...]:
    """The sequences below a folder that have a motion and at least one video, by name.

    Empty if the folder holds no AIST++ annotations.

    Args:
        root: the folder.
        unfilmed: also those without a video.

    Raises:
        SourceError: the annotations are incomplete, or there are no videos.
    """
    tree = find_tree(root)
    if tree is None:
        return ()
    sequences = [name for name in tree.sequences() if unfilmed or name in tree.videos]
    if not sequences:
        raise SourceError(
            f"{root}: {len(tree.sequences())} motions but none of their videos; accept the terms at"
            " https://aistdancedb.ongaaccel.jp, download the videos of the sequences you want, and"
            " put them into a folder there."
        )
    synthetic = (root / SYNTHETIC_SIGN).is_file()
    return tuple(
        Found(
            name=name,
            path=root,
            variant="AIST++ annotations and AIST videos",
            dataset="synthetic" if synthetic else "aist++",
        )
        for name in sequences
    )


def survey_aist(found: Found, options: OpenOptions) -> Survey:
    """What is there of a sequence and what is wrong with it; needs no body model.

    Raises:
        SourceError: an annotation file is missing or damaged.
    """
    seen = inspect_aist(found, options)
    sizes = sorted({view.video.size for view in seen.views})
    rates = sorted({round(view.video.rate, 3) for view in seen.views})
    needed = needed_cameras(found.name, options, seen.protocol_frames)
    names = [view.camera.name for view in seen.views]
    protocol = dance_protocol(found.name, options, names, seen.protocol_frames)
    facts = (
        ("sequence", found.name),
        ("dancer", dancer_of(found.name)),
        ("protocol", f"{protocol.name}, {protocol.role}: needs {', '.join(needed)}"),
        ("camera setting", seen.setting),
        ("views", ", ".join(view.camera.name for view in seen.views) or "none"),
        ("picture size", ", ".join(f"{width} x {height}" for width, height in sizes)),
        ("pictures per second", ", ".join(f"{rate:g}" for rate in rates)),
        ("motion", f"{len(seen.motion.poses)} frames at 60 per second"),
        ("scaling", f"{seen.motion.scaling:.3f} world units per metre"),
        ("frames", f"{len(seen.frames)}: {seen.frames[0]} to {seen.frames[-1]}"),
        ("masks", mask_source(seen.given, METHOD)),
    )
    warnings = protocol_findings(found.name, protocol, names, seen.protocol_frames)
    return Survey(found, facts, (*warnings, *_weighed(found, options, seen)))


def open_aist(found: Found, options: OpenOptions) -> SourceSequence:
    """A sequence ready to be prepared: fits, cameras and protocol, and a reader of its videos.

    Raises:
        SourceError: annotations are missing or wrong, no view is usable, the sequence is on the
            ignore list (and not accepted), or there is no body model.
    """
    segmenter = None if options.segmenter is None else tried_segmenter(options.segmenter)
    seen = inspect_aist(found, options)
    model, model_name, model_findings = _body_model(found, options)
    fits, shape = fits_of_motion(seen.motion, seen.frames, model)
    cameras = tuple(view.camera for view in seen.views)
    require_plausible_distance(cameras, fits.world_from_body[:, :3, 3])
    names = [camera.name for camera in cameras]
    protocol = dance_protocol(found.name, options, names, seen.protocol_frames)
    warnings = protocol_findings(found.name, protocol, names, seen.protocol_frames)
    return SourceSequence(
        found=found,
        actor=dancer_of(found.name),
        world_up=np.array(WORLD_UP),
        cameras=cameras,
        frames=seen.frames,
        fits=fits,
        shape=shape,
        protocols=(protocol,),
        wanted=_wanted(protocol, options, seen),
        body_model=model_name,
        mask_source=mask_source(seen.given, METHOD if segmenter is None else segmenter.name),
        source_terms=SYNTHETIC_TERMS if found.dataset == "synthetic" else SOURCE_TERMS,
        notes=(
            *seen.notes,
            f"Body model {model_name}, file digest {model.digest}, zero betas.",
            *(finding.sentence for finding in warnings),
        ),
        source_digests=annotation_digests(found, seen),
        findings=(
            *warnings,
            *_weighed(found, options, seen),
            *model_findings,
            *_agreement(found, seen, fits),
        ),
        reader=AistReader(
            seen.views, AistScene(seen.frames, fits, model.faces), seen.given, segmenter
        ),
        published_background="white",
    )


def _body_model(found: Found, options: OpenOptions) -> tuple[BodyModel, str, tuple[Finding, ...]]:
    """The model, its name for the file, and a warning if it is not the male one."""
    if options.body_model is None:
        if found.dataset == "synthetic":
            return free_body(), FREE_BODY_NAME, ()
        raise SourceError(
            "AIST++ was fitted with SMPL's male model, and no body model is given: register at"
            " https://smpl.is.tue.mpg.de, download SMPL for Python, and pass the file"
            " basicModel_m_lbs_10_207_0_v1.0.0.pkl (or SMPL_MALE.pkl) with --body-model."
        )
    model = load_body_model(options.body_model)
    name = options.body_model.name.lower()
    if found.dataset == "synthetic":
        return model, options.body_model.stem, ()
    female = "female" in name or "_f_" in name
    if not female and ("male" in name or "_m_" in name):
        return model, "smpl male", ()
    sentence = (
        f"{options.body_model.name} is not SMPL's male model by its name; AIST++ was fitted with"
        " the male one, and another is off by centimetres."
    )
    return model, options.body_model.stem, (Finding("warning", "body model", sentence),)


def dance_protocol(
    sequence: str, options: OpenOptions, cameras: list[str], frames: Int64
) -> Protocol:
    """The published protocol of a sequence, or the generic one with the role the user gave.

    Any dance of a published test dancer is held out, and so is a published pre-training dancer whom
    the user names as held out.
    """
    dancer = dancer_of(sequence)
    named = {dancer, sequence} & set(options.held_out)
    role: Role = "held_out" if named or protocols.aist_role(dancer) == "held_out" else "pretraining"
    official = protocols.aist_protocol(sequence, cameras, frames)
    if official is not None and official.role == role:
        return official
    return protocols.generic_protocol(role, cameras, frames)


def protocol_findings(
    sequence: str, protocol: Protocol, cameras: list[str], frames: Int64
) -> tuple[Finding, ...]:
    """A warning, if a published test dancer's published protocol does not apply."""
    dancer = dancer_of(sequence)
    if protocol.name != "generic" or protocols.aist_role(dancer) != "held_out":
        return ()
    if sequence != AIST_SEQUENCES[dancer]:
        reason = f"the published lists are for {AIST_SEQUENCES[dancer]}"
    elif "c01" not in cameras:
        reason = "the published lists are for camera c01, which has no usable video"
    else:
        reason = (
            "the published lists need c01, a camera of c02 to c08, and frames beyond 1400; there "
            f"are {', '.join(cameras)}, and frames {frames[0]} to {frames[-1]}"
        )
    return (held_out_warning(dancer, protocol, reason, len(frames)),)


def needed_cameras(sequence: str, options: OpenOptions, frames: Int64) -> tuple[str, ...]:
    """The cameras whose videos are needed: for pre-training the first, c09 never.

    Args:
        sequence: its name.
        options: with the roles, and whether all pictures are asked for.
        frames: those that protocols choose from.
    """
    # The last stands beside the first, and the published experiments leave it out.
    names = CAMERA_NAMES[:-1]
    if options.pairs == "all":
        return names
    protocol = dance_protocol(sequence, options, list(names), frames)
    seen = {camera for camera, _ in protocols.needed_pairs(protocol)}
    return tuple(name for name in names if name in seen)


def _weighed(found: Found, options: OpenOptions, seen: AistInspection) -> tuple[Finding, ...]:
    """The findings; those on absent views that are not needed are only notes."""
    spare = set(CAMERA_NAMES) - set(needed_cameras(found.name, options, seen.protocol_frames))
    return tuple(
        replace(finding, severity="note") if finding.entry in spare else finding
        for finding in seen.findings
    )


def _wanted(protocol: Protocol, options: OpenOptions, seen: AistInspection) -> NDArray[np.bool_]:
    names = [view.camera.name for view in seen.views]
    if options.pairs == "all":
        return np.ones((len(names), len(seen.frames)), np.bool_)
    pairs = protocols.needed_pairs(protocol)
    return np.array([[(name, int(frame)) in pairs for frame in seen.frames] for name in names])


def _agreement(found: Found, seen: AistInspection, fits: BodyFits) -> tuple[Finding, ...]:
    """What the data set's keypoints say about the fit, where they are there."""
    findings: tuple[Finding, ...] = ()
    joints = world_joints(fits)
    name = f"{found.name}.pkl"
    if seen.tree.keypoints3d is not None and (seen.tree.keypoints3d / name).is_file():
        points = read_keypoints(seen.tree.keypoints3d / name, "keypoints3d_optim", 3)
        inside = seen.frames < len(points)
        metres = points[seen.frames[inside]] / seen.motion.scaling
        findings += swapped_sides_finding(joints[inside], metres)
    if seen.tree.keypoints2d is not None and (seen.tree.keypoints2d / name).is_file():
        points = read_keypoints(seen.tree.keypoints2d / name, "keypoints2d", 3)
        cameras = tuple(view.camera for view in seen.views)
        findings += keypoint_findings(cameras, joints, points, seen.frames)
    return findings
