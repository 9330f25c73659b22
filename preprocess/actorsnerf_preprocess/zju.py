"""ZJU-MoCap as preparation sees it: every tree in circulation, metres, the standard convention.

Built to the documented formats. What differs from the released ActorsNeRF preparation: support
pictures are undistorted like all others, the canonical joints come from the body model at the mean
shape, and frame 810 + k of subject 396 is paired with fit 810 + k (the released script pairs it
with k).
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets import protocols
from actorsnerf_datasets.body_model import BodyModel, load_body_model
from actorsnerf_datasets.types import Protocol, Role
from actorsnerf_preprocess.free_body import FREE_BODY_NAME, free_body
from actorsnerf_preprocess.image_files import ImageReader
from actorsnerf_preprocess.source import (
    Finding,
    Found,
    OpenOptions,
    SourceCamera,
    SourceError,
    SourceSequence,
    Survey,
)
from actorsnerf_preprocess.zju_annotations import world_up
from actorsnerf_preprocess.zju_bodies import ReadFits, read_fits
from actorsnerf_preprocess.zju_choice import FitChoice, choose_fit
from actorsnerf_preprocess.zju_converted import (
    converted_fits,
    is_converted_tree,
    read_converted_tree,
    survey_converted,
)
from actorsnerf_preprocess.zju_inspection import (
    ZjuInspection,
    facts,
    inspect_zju,
    mask_source,
    source_digests,
)
from actorsnerf_preprocess.zju_tree import VARIANT_LINES, is_zju_tree, subject_of

SYNTHETIC_SIGN = "synthetic.json"
"""A file of this name in a sequence's folder or above marks a tree of our own generator."""
SEARCH_DEPTH = 2
"""How many folders below the source a sequence may lie."""
SOURCE_TERMS = (
    "redistribution = not allowed (ZJU-MoCap is for non-commercial research, on request from its "
    "authors); body model under its own licence"
)
SYNTHETIC_TERMS = "redistribution = allowed (CC0 body, generated pictures)"
NEAREST, FARTHEST = 0.5, 20.0
"""Metres from a camera to a person on a stage; the released data has about 3."""


def find_zju(root: Path) -> tuple[Found, ...]:
    """The sequences at or below a folder, by name; empty if it has none of this format.

    Raises:
        SourceError: two sequences have the same name.
    """
    found = tuple(_found(path) for path in _sequences(root, SEARCH_DEPTH))
    names = [each.name for each in found]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        places = ", ".join(str(each.path) for each in found if each.name == repeated[0])
        raise SourceError(f"{root}: two sequences are called {repeated[0]}: {places}.")
    return tuple(sorted(found, key=lambda each: each.name))


def survey_zju(found: Found, options: OpenOptions) -> Survey:
    """What is there of a sequence and what is wrong with it; needs no body model.

    Raises:
        SourceError: an annotation file is missing or damaged.
    """
    if found.dataset == "converted":
        return survey_converted(found)
    seen = inspect_zju(found, options)
    found = replace(found, variant=VARIANT_LINES[seen.tree.variant])
    lines = (("sequence", found.name), ("actor", _actor(found)), *facts(seen))
    return Survey(found, lines, seen.findings)


def open_zju(found: Found, options: OpenOptions) -> SourceSequence:
    """A sequence ready to be prepared: fits, cameras and protocol, and a reader of its pictures.

    Raises:
        SourceError: annotations or fits are missing or wrong, or there is no body model.
    """
    model, body_model = body_model_for(found, options)
    if found.dataset == "converted":
        return _open_converted(found, options, model, body_model)
    seen = inspect_zju(found, options)
    tree = seen.tree
    protocol = protocol_of(found, options, tree.camera_names, tree.frames)
    wanted = wanted_pairs(protocol, options, tree.camera_names, tree.frames)
    positions = np.flatnonzero(wanted.any(axis=0))
    choice = choose_fit(tree.root, tuple(tree.frames[p] for p in positions), model)
    read = read_fits(tree.root, tuple(tree.frames[p] for p in positions), choice, model)
    positions = positions[list(read.positions)]
    frames = np.array([tree.frames[p] for p in positions], np.int64)
    require_plausible_distance(seen.cameras, read)
    files = {
        (camera, index): seen.picture_files(camera, int(position))
        for camera in range(len(seen.cameras))
        for index, position in enumerate(positions)
    }
    return SourceSequence(
        found=replace(found, variant=VARIANT_LINES[tree.variant]),
        actor=_actor(found),
        world_up=seen.world_up,
        cameras=seen.cameras,
        frames=frames,
        fits=read.fits,
        shape=read.shape,
        protocols=(protocol,),
        wanted=wanted[:, positions],
        body_model=body_model if choice.pose_blend else f"{body_model}, without pose blend shapes",
        mask_source=mask_source(tree.mask_sets) or "none",
        source_terms=SYNTHETIC_TERMS if found.dataset == "synthetic" else SOURCE_TERMS,
        notes=(*seen.notes, *read.notes, *_note(protocol, model, body_model)),
        source_digests=source_digests(tree.root, _digested(seen, choice)),
        findings=(*_relevant(seen, wanted), *choice.findings, *read.findings),
        reader=ImageReader(tree.root, files, tuple(camera.size for camera in seen.cameras)),
    )


def _relevant(seen: ZjuInspection, wanted: NDArray[np.bool_]) -> tuple[Finding, ...]:
    """The inspection's findings; absent pictures are only a note if the protocol needs none."""
    tree = seen.tree
    needed = {(int(camera), int(position)) for camera, position in np.argwhere(wanted)}
    if needed - tree.existing:
        return seen.findings
    absent = {"pictures", *tree.camera_names}
    return tuple(
        replace(finding, severity="note") if finding.entry in absent else finding
        for finding in seen.findings
    )


def _open_converted(
    found: Found, options: OpenOptions, model: BodyModel, body_model: str
) -> SourceSequence:
    tree = read_converted_tree(found.path)
    names = tuple(camera.name for camera in tree.cameras)
    protocol = protocol_of(found, options, names, tree.frames)
    wanted = wanted_pairs(protocol, options, names, tree.frames)
    positions = np.flatnonzero(wanted.any(axis=0))
    frames = tuple(tree.frames[p] for p in positions)
    read, findings = converted_fits(tree, frames, model)
    require_plausible_distance(tree.cameras, read)
    up = world_up(np.stack([camera.R for camera in tree.cameras]))
    files = {
        (camera, index): tree.picture_files(camera, frame)
        for camera in range(len(tree.cameras))
        for index, frame in enumerate(frames)
    }
    digested = [f"{folder}/{n}.pkl" for folder in tree.folders for n in ("cameras", "mesh_infos")]
    return SourceSequence(
        found=found,
        actor=_actor(found),
        world_up=up,
        cameras=tree.cameras,
        frames=np.array(frames, np.int64),
        fits=read.fits,
        shape=read.shape,
        protocols=(protocol,),
        wanted=wanted[:, positions],
        body_model=body_model,
        mask_source="masks of the converted tree; not zero = person",
        source_terms=SOURCE_TERMS,
        notes=(*read.notes, *_note(protocol, model, body_model)),
        source_digests=source_digests(tree.root, tuple(digested)),
        findings=(*tree.findings, *findings, *read.findings),
        reader=ImageReader(tree.root, files, tuple(camera.size for camera in tree.cameras)),
    )


def body_model_for(found: Found, options: OpenOptions) -> tuple[BodyModel, str]:
    """The body model to use and its name.

    Raises:
        SourceError: none is given, and the sequence is not synthetic.
    """
    if options.body_model is not None:
        stem = options.body_model.stem
        return load_body_model(options.body_model), (
            "smpl neutral" if "neutral" in stem.lower() else stem
        )
    if found.dataset == "synthetic":
        return free_body(), FREE_BODY_NAME
    raise SourceError(
        f"{found.name}: ZJU-MoCap was fitted with SMPL's neutral model, and no body model is "
        "given: register at https://smplify.is.tue.mpg.de, download SMPLify, and pass its file "
        "basicModel_neutral_lbs_10_207_0_v1.0.0.pkl (also called SMPL_NEUTRAL.pkl) with "
        "--body-model."
    )


def protocol_of(
    found: Found, options: OpenOptions, cameras: tuple[str, ...], frames: tuple[int, ...]
) -> Protocol:
    """The published protocol of a subject, or the generic one with the role the user gave."""
    numbers = np.array(frames, np.int64)
    official = protocols.zju_protocol(subject_of(found.path.name), list(cameras), numbers)
    if official is not None and found.dataset != "synthetic":
        return official
    names = {found.name, found.path.name, _actor(found), subject_of(found.path.name)}
    held_out = names & set(options.held_out)
    role: Role = "held_out" if held_out else "pretraining"
    return protocols.generic_protocol(role, list(cameras), numbers)


def wanted_pairs(
    protocol: Protocol, options: OpenOptions, cameras: tuple[str, ...], frames: tuple[int, ...]
) -> NDArray[np.bool_]:
    """(C, F): the pairs to prepare."""
    if options.pairs == "all":
        return np.ones((len(cameras), len(frames)), np.bool_)
    pairs = protocols.needed_pairs(protocol)
    return np.array([[(name, frame) in pairs for frame in frames] for name in cameras])


def require_plausible_distance(cameras: tuple[SourceCamera, ...], read: ReadFits) -> None:
    """Raises if the fits and the cameras cannot be in the same unit.

    Raises:
        SourceError: a camera is nearer than half a metre or farther than 20 m at the median.
    """
    bodies = read.fits.world_from_body[:, :3, 3]
    for camera in cameras:
        centre = -camera.R.T @ camera.T
        distance = float(np.median(np.linalg.norm(bodies - centre, axis=1)))
        if not NEAREST < distance < FARTHEST:
            raise SourceError(
                f"{camera.name}: the person is {distance:.3g} m from the camera, expected "
                f"{NEAREST} to {FARTHEST} m: are T of annots.npy and Th of the fits in different "
                "units?"
            )


def _sequences(root: Path, depth: int) -> list[Path]:
    if is_zju_tree(root) or is_converted_tree(root):
        return [root]
    if depth == 0 or not root.is_dir():
        return []
    folders = sorted(path for path in root.iterdir() if path.is_dir())
    return [path for folder in folders for path in _sequences(folder, depth - 1)]


def _found(path: Path) -> Found:
    if not is_zju_tree(path):
        variant = "prepared by HumanNeRF or ActorsNeRF"
        return Found(path.name, path, variant, "converted")
    places = (path, path.parent, path.parent.parent)
    synthetic = any((place / SYNTHETIC_SIGN).is_file() for place in places)
    return Found(path.name, path, "ZJU-MoCap", "synthetic" if synthetic else "zju-mocap")


def _actor(found: Found) -> str:
    subject = subject_of(found.path.name)
    return f"zju-{subject}" if subject.isdigit() and found.dataset != "synthetic" else subject


def _note(protocol: Protocol, model: BodyModel, name: str) -> tuple[str, ...]:
    notes = [f"Body model {name}, file digest {model.digest}."]
    if protocol.name == "generic":
        notes.append(f"The actor is in no published list and counts as {protocol.role}.")
    return tuple(notes)


def _digested(seen: ZjuInspection, choice: FitChoice) -> tuple[str, ...]:
    names = (seen.tree.annotation_file.name, choice.folders.parameters, choice.folders.vertices)
    return tuple(name for name in names if (seen.tree.root / name).exists())
