"""The fits of many frames in the standard convention, each verified against its vertices."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from actorsnerf_datasets import types
from actorsnerf_datasets.body_model import BodyModel, pose, rest
from actorsnerf_datasets.conventions import world_from_body
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.fit_checks import VERTEX_TOLERANCE
from actorsnerf_preprocess.source import Finding, SourceError
from actorsnerf_preprocess.zju_choice import FitChoice
from actorsnerf_preprocess.zju_fits import (
    RawFit,
    fit_file,
    largest_distance,
    pose_without_root,
    read_fit,
    standard_transform,
    stored_vertices,
)

LARGEST_SHARE_OFF = 0.1
"""If more frames than this share have vertices that do not fit, two fits are mixed."""


@dataclass(frozen=True)
class ReadFits:
    """The fits of the frames that have one."""

    positions: tuple[int, ...]
    """Positions in the asked frame numbers whose fit is usable."""
    fits: types.BodyFits
    shape: types.ActorShape
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]


def read_fits(root: Path, frames: tuple[int, ...], choice: FitChoice, model: BodyModel) -> ReadFits:
    """The fits of the given frames in the standard convention, verified one by one.

    Args:
        root: the sequence's folder.
        frames: frame numbers; files have the same numbers.
        choice: from `choose_fit`.
        model: the body model of the fits.

    Raises:
        SourceError: no frame has a usable fit, or many do not belong to their vertices.
    """
    positions, raw, missing, broken = [], [], [], []
    for position, frame in enumerate(frames):
        path = fit_file(root / choice.folders.parameters, frame)
        if path is None:
            missing.append(frame)
            continue
        try:
            raw.append(read_fit(path))
            positions.append(position)
        except UserError as error:
            broken.append((frame, str(error)))
    if not raw:
        folder = root / choice.folders.parameters
        why = broken[0][1] if broken else _available(folder)
        raise SourceError(
            f"{folder}: no usable fit for any of {len(frames)} frames (first asked: "
            f"{frames[0]}.npy); {why}"
        )
    findings = _missing_findings(choice.folders.parameters, missing, broken)
    read = verified_fits(root, tuple(frames[p] for p in positions), raw, choice, model)
    return replace(read, positions=tuple(positions), findings=(*findings, *read.findings))


def verified_fits(
    root: Path, frames: tuple[int, ...], raw: list[RawFit], choice: FitChoice, model: BodyModel
) -> ReadFits:
    """Fits in the standard convention, each with its vertices: the stored ones where they fit.

    Args:
        root: the folder that has the vertices.
        frames: frame numbers, as many as fits.
        raw: the fits as found.
        choice: which vertices belong to them, and how those are rebuilt.
        model: the body model of the fits.

    Raises:
        SourceError: the vertices of many frames do not belong to the fits.
    """
    fits, off, unread = _body_fits(root, frames, raw, choice, model)
    notes = [choice.sentence]
    if any(fit.padded for fit in raw):
        notes.append("Poses of 69 numbers were given a zero root rotation.")
    if any(np.any(fit.pose[0]) for fit in raw):
        notes.append("Root rotations inside `poses` were folded into the global transform.")
    findings = _vertex_findings(root, choice, len(raw), off, unread)
    if off:
        notes.append(f"Vertices of {len(off)} frames were rebuilt; their files do not fit.")
    joints, vertices = rest(model, fits.betas.mean(axis=0))
    shape = types.ActorShape(fits.betas.mean(axis=0), joints, vertices.astype(np.float32))
    return ReadFits(tuple(range(len(raw))), fits, shape, tuple(findings), tuple(notes))


def _body_fits(
    root: Path, frames: tuple[int, ...], raw: list[RawFit], choice: FitChoice, model: BodyModel
) -> tuple[types.BodyFits, list[int], list[int]]:
    """The fits, the frames whose vertex file does not fit, and those without a vertex file."""
    standard = [standard_transform(fit, model) for fit in raw]
    orient, transl = (np.stack(part) for part in zip(*standard, strict=True))
    bodies, off, unread = [], [], []
    rest_joints = np.stack([rest(model, fit.betas)[0] for fit in raw])
    matrices = world_from_body(orient, transl, rest_joints[:, 0])
    joints = []
    for frame, fit, matrix in zip(frames, raw, matrices, strict=True):
        posed = pose(model, fit.betas, pose_without_root(fit), choice.pose_blend)
        joints.append(posed.joints)
        vertices = posed.vertices
        stored = _readable_vertices(root / choice.folders.vertices, frame, model)
        if stored is None:
            unread.append(frame)
        else:
            in_body = (stored - matrix[:3, 3]) @ matrix[:3, :3]
            # Compared as they will be stored, so that the check of the file agrees.
            in_body = in_body.astype(np.float32).astype(np.float64)
            fits_well = largest_distance(in_body, posed.vertices) <= VERTEX_TOLERANCE
            vertices = in_body if fits_well else posed.vertices
            if not fits_well:
                off.append(frame)
        bodies.append(vertices.astype(np.float32))
    fits = types.BodyFits(
        global_orient=orient,
        transl=transl,
        body_pose=np.stack([fit.pose[1:] for fit in raw]),
        betas=np.stack([fit.betas for fit in raw]),
        world_from_body=matrices,
        rest_joints=rest_joints,
        posed_joints=np.stack(joints),
        posed_vertices=np.stack(bodies),
    )
    return fits, off, unread


def _readable_vertices(folder: Path, frame: int, model: BodyModel) -> types.Float64 | None:
    path = fit_file(folder, frame)
    if path is None:
        return None
    try:
        return stored_vertices(path, model)
    except UserError:
        return None


def _available(folder: Path) -> str:
    numbers = sorted(int(path.stem) for path in folder.glob("*.npy") if path.stem.isdigit())
    if not numbers:
        return "the folder holds no numbered .npy file"
    return f"the folder holds {len(numbers)} files, {numbers[0]}.npy to {numbers[-1]}.npy"


def _missing_findings(
    folder: str, missing: list[int], broken: list[tuple[int, str]]
) -> list[Finding]:
    findings = []
    if missing:
        text = f"{len(missing)} frames have no fit and are left out (first: {missing[:5]})."
        findings.append(Finding("warning", folder, text))
    if broken:
        text = f"{len(broken)} fits are unusable and left out; the first: {broken[0][1]}"
        findings.append(Finding("warning", folder, text))
    return findings


def _vertex_findings(
    root: Path, choice: FitChoice, used: int, off: list[int], unread: list[int]
) -> list[Finding]:
    folder = choice.folders.vertices
    apart = f"by more than {1000 * VERTEX_TOLERANCE:.0f} mm"
    if len(off) > LARGEST_SHARE_OFF * used:
        raise SourceError(
            f"{root / choice.folders.parameters}: the vertices of {len(off)} of {used} frames "
            f"differ from {folder} {apart} (first: frame {off[0]}): were files of two fits "
            "mixed in one folder?"
        )
    findings = []
    if off:
        text = (
            f"{len(off)} files differ from the vertices rebuilt from {choice.folders.parameters} "
            f"{apart} (frames {off[:5]}); rebuilt ones are stored."
        )
        findings.append(Finding("warning", folder, text))
    if unread and (root / folder).is_dir():
        text = (
            f"{len(unread)} frames have no readable vertices (first: {unread[:5]}); rebuilt ones "
            "are stored."
        )
        findings.append(Finding("warning", folder, text))
    return findings
