"""ZJU-MoCap as preparation sees it: every tree in circulation, metres, the standard convention.

Built to the documented formats. What differs from the released ActorsNeRF preparation: support
pictures are undistorted like all others, the canonical joints come from the body model at the mean
shape, and frame 810 + k of subject 396 is paired with fit 810 + k (the released script pairs it
with k).
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from actorsnerf_datasets.body_model import BodyModel, load_body_model
from actorsnerf_datasets.types import Float64
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
    converted_facts,
    converted_fits,
    is_converted_tree,
    read_converted_tree,
)
from actorsnerf_preprocess.zju_inspection import (
    ZjuInspection,
    facts,
    inspect_zju,
    mask_source,
    source_digests,
)
from actorsnerf_preprocess.zju_protocol import (
    actor_of,
    protocol_findings,
    protocol_notes,
    protocol_of,
    wanted_pairs,
    weighed_findings,
)
from actorsnerf_preprocess.zju_tree import VARIANT_LINES, is_zju_tree

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
    if _is_converted(found):
        tree = read_converted_tree(found.path)
        names = tuple(camera.name for camera in tree.cameras)
        lines = (("variant", found.variant), *converted_facts(tree))
        return _survey(found, options, (names, tree.frames, tree.existing), lines, tree.findings)
    seen = inspect_zju(found, options)
    found = replace(found, variant=VARIANT_LINES[seen.tree.variant])
    there = (seen.tree.camera_names, seen.tree.frames, seen.tree.existing)
    return _survey(found, options, there, facts(seen), seen.findings)


def open_zju(found: Found, options: OpenOptions) -> SourceSequence:
    """A sequence ready to be prepared: fits, cameras and protocol, and a reader of its pictures.

    Raises:
        SourceError: annotations or fits are missing or wrong, or there is no body model.
    """
    model, body_model = body_model_for(found, options)
    if _is_converted(found):
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
    absent = _absent(tree.camera_names)
    files = {
        (camera, index): seen.picture_files(camera, int(position))
        for camera in range(len(seen.cameras))
        for index, position in enumerate(positions)
    }
    return SourceSequence(
        found=replace(found, variant=VARIANT_LINES[tree.variant]),
        actor=actor_of(found),
        world_up=seen.world_up,
        cameras=seen.cameras,
        frames=frames,
        fits=read.fits,
        shape=read.shape,
        protocols=(protocol,),
        wanted=wanted[:, positions],
        body_model=body_model if choice.pose_blend else f"{body_model}, without pose blend shapes",
        mask_source=mask_source(tree.mask_sets) or "none",
        source_terms=_terms(found),
        notes=(
            *seen.notes,
            *read.notes,
            f"Body model {body_model}, file digest {model.digest}.",
            *protocol_notes(found, protocol, tree.camera_names, tree.frames),
        ),
        source_digests=source_digests(tree.root, _digested(seen, choice)),
        findings=(
            *protocol_findings(found, protocol, tree.camera_names, tree.frames),
            *weighed_findings(seen.findings, wanted, tree.existing, absent),
            *choice.findings,
            *read.findings,
        ),
        reader=ImageReader(tree.root, files, tuple(camera.size for camera in seen.cameras)),
    )


def _survey(
    found: Found,
    options: OpenOptions,
    there: tuple[tuple[str, ...], tuple[int, ...], frozenset[tuple[int, int]]],
    lines: tuple[tuple[str, str], ...],
    findings: tuple[Finding, ...],
) -> Survey:
    """The survey of a tree; `there` has its cameras, frames, and the pairs with a picture."""
    cameras, frames, existing = there
    protocol = protocol_of(found, options, cameras, frames)
    wanted = wanted_pairs(protocol, options, cameras, frames)
    present = sum((int(c), int(f)) in existing for c, f in np.argwhere(wanted))
    needed = f"{present} of {int(wanted.sum())} pictures that it needs are there"
    if options.pairs == "all":
        needed = f"{present} of {wanted.size} pictures are there; all are asked for"
    return Survey(
        found,
        (
            ("sequence", found.name),
            ("actor", actor_of(found)),
            ("protocol", f"{protocol.name}, {protocol.role}: {needed}"),
            *lines,
        ),
        (
            *protocol_findings(found, protocol, cameras, frames),
            *weighed_findings(findings, wanted, existing, _absent(cameras)),
        ),
    )


def _absent(cameras: tuple[str, ...]) -> set[str]:
    """What findings about absent pictures are about."""
    return {"pictures", *cameras, *(f"camera {name}" for name in cameras)}


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
    absent = _absent(names)
    digested = [f"{folder}/{n}.pkl" for folder in tree.folders for n in ("cameras", "mesh_infos")]
    return SourceSequence(
        found=found,
        actor=actor_of(found),
        world_up=up,
        cameras=tree.cameras,
        frames=np.array(frames, np.int64),
        fits=read.fits,
        shape=read.shape,
        protocols=(protocol,),
        wanted=wanted[:, positions],
        body_model=body_model,
        mask_source="masks of the converted tree; not zero = person",
        source_terms=_terms(found),
        notes=(
            *_up_notes(names, up),
            *read.notes,
            f"Body model {body_model}, file digest {model.digest}.",
            *protocol_notes(found, protocol, names, tree.frames),
        ),
        source_digests=source_digests(tree.root, tuple(digested)),
        findings=(
            *protocol_findings(found, protocol, names, tree.frames),
            *weighed_findings(tree.findings, wanted, tree.existing, absent),
            *findings,
            *read.findings,
        ),
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
    places = (path, path.parent, path.parent.parent)
    synthetic = any((place / SYNTHETIC_SIGN).is_file() for place in places)
    if not is_zju_tree(path):
        variant = "converted: prepared by HumanNeRF or ActorsNeRF"
        return Found(path.name, path, variant, "synthetic" if synthetic else "converted")
    return Found(path.name, path, "ZJU-MoCap", "synthetic" if synthetic else "zju-mocap")


def _is_converted(found: Found) -> bool:
    return not is_zju_tree(found.path)


def _up_notes(cameras: tuple[str, ...], up: Float64) -> tuple[str, ...]:
    """What a converted file says about its world's vertical."""
    text = f"World up {np.round(up, 3).tolist()} is minus the cameras' mean image-down direction"
    if len(cameras) == 1:
        return (f"{text}; of one camera alone it is off by that camera's tilt.",)
    return (f"{text}.",)


def _terms(found: Found) -> str:
    return SYNTHETIC_TERMS if found.dataset == "synthetic" else SOURCE_TERMS


def _digested(seen: ZjuInspection, choice: FitChoice) -> tuple[str, ...]:
    names = (seen.tree.annotation_file.name, choice.folders.parameters, choice.folders.vertices)
    return tuple(name for name in names if (seen.tree.root / name).exists())
