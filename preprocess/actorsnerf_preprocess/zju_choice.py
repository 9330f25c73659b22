"""Which of a tree's SMPL fits is used, told by rebuilding vertices and not by a folder's name.

Older fits (`params`) were made without pose blend shapes, newer ones (`new_params`) with them, and
folders get renamed. So the vertices are rebuilt both ways and compared with the folder of vertices
that belongs to the fit; parameters of one fit are never paired with vertices of another.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from actorsnerf_datasets.body_model import BodyModel
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.fit_checks import VERTEX_TOLERANCE
from actorsnerf_datasets.pickles import PickleError
from actorsnerf_preprocess.source import Finding, SourceError
from actorsnerf_preprocess.zju_fits import (
    fit_file,
    largest_distance,
    read_fit,
    stored_vertices,
    world_vertices,
)

PROBED_FRAMES = 5


@dataclass(frozen=True)
class FitFolders:
    """Two folders that belong together."""

    parameters: str
    vertices: str


CANDIDATES = (
    FitFolders("new_params", "new_vertices"),
    FitFolders("smpl_params", "smpl_vertices"),
    FitFolders("params", "vertices"),
)
"""In the order of preference; the published experiments use `new_params`."""


@dataclass(frozen=True)
class FitChoice:
    """Which fit of the tree is used, and how its vertices are rebuilt."""

    folders: FitFolders
    pose_blend: bool
    sentence: str
    findings: tuple[Finding, ...]


def fit_folders(root: Path) -> tuple[FitFolders, ...]:
    """The fits that a tree has, best first."""
    return tuple(folders for folders in CANDIDATES if (root / folders.parameters).is_dir())


def choose_fit(root: Path, frames: tuple[int, ...], model: BodyModel) -> FitChoice:
    """The best fit of a tree whose vertices can be rebuilt.

    Raises:
        SourceError: there is no fit, or none whose vertices can be rebuilt.
    """
    candidates = fit_folders(root)
    if not candidates:
        names = ", ".join(folders.parameters for folders in CANDIDATES)
        raise SourceError(f"{root}: has no folder of SMPL fits, looked for {names}.")
    refusals: list[str] = []
    for folders in candidates:
        probed = _probed(root / folders.parameters, frames)
        if not probed:
            refusals.append(
                f"{root / folders.parameters} has no file of any of the {len(frames)} frames"
            )
            continue
        errors = _errors(root, folders, probed, model)
        if errors is None:
            return _unverified(folders)
        blended, plain = errors
        if min(blended, plain) <= VERTEX_TOLERANCE:
            return _choice(folders, blended, plain, refusals)
        refusals.append(_refusal(root, folders, probed, model, (blended, plain)))
    raise SourceError("; ".join(refusals))


def _errors(
    root: Path, folders: FitFolders, frames: tuple[int, ...], model: BodyModel
) -> tuple[float, float] | None:
    """Largest vertex error, metres, with and without pose blend shapes; None: nothing to compare.

    That of the better half of the frames, so that a bad file does not decide.
    """
    blended, plain = [], []
    for frame in frames:
        path = fit_file(root / folders.parameters, frame)
        vertices = fit_file(root / folders.vertices, frame)
        if vertices is None or path is None:
            continue
        # A broken file is counted later, when all frames are read; it decides nothing here.
        try:
            fit = read_fit(path)
        except UserError:
            continue
        try:
            stored = stored_vertices(vertices, model)
        except PickleError:
            continue
        blended.append(largest_distance(world_vertices(fit, model, True), stored))
        plain.append(largest_distance(world_vertices(fit, model, False), stored))
    middle = (len(blended) - 1) // 2
    return (sorted(blended)[middle], sorted(plain)[middle]) if blended else None


def _choice(folders: FitFolders, blended: float, plain: float, refusals: list[str]) -> FitChoice:
    pose_blend = blended <= plain
    error = 1000 * min(blended, plain)
    kind = "with" if pose_blend else "without"
    sentence = (
        f"Fits are {folders.parameters}, made {kind} pose blend shapes: rebuilt vertices differ "
        f"from {folders.vertices} by {error:.3g} mm at most."
    )
    findings = [Finding("warning", folders.parameters, refusal) for refusal in refusals]
    if pose_blend != (folders.parameters != "params"):
        text = (
            f"Its vertices are those of a fit {kind} pose blend shapes, unlike the released "
            "archives' folder of this name: renamed, or made with other tools."
        )
        findings.append(Finding("note", folders.parameters, text))
    return FitChoice(folders, pose_blend, sentence, tuple(findings))


def _refusal(
    root: Path,
    folders: FitFolders,
    frames: tuple[int, ...],
    model: BodyModel,
    errors: tuple[float, float],
) -> str:
    text = (
        f"{root / folders.parameters}: rebuilt vertices differ from {folders.vertices} by "
        f"{1000 * errors[0]:.3g} mm with pose blend shapes and {1000 * errors[1]:.3g} mm without, "
        f"expected below {1000 * VERTEX_TOLERANCE:.0f} mm in one of the two"
    )
    for other in CANDIDATES:
        if other.vertices == folders.vertices or not (root / other.vertices).is_dir():
            continue
        crossed = _errors(root, replace(folders, vertices=other.vertices), frames, model)
        if crossed is not None and min(crossed) <= VERTEX_TOLERANCE:
            return text + f" (they fit {other.vertices}: the folders of two fits were mixed)"
    return text + ": is the body model SMPL's neutral one, as the fits need?"


def _probed(folder: Path, frames: tuple[int, ...]) -> tuple[int, ...]:
    """A few frames that have a file, spread over all."""
    present = [frame for frame in frames if fit_file(folder, frame)]
    count = min(PROBED_FRAMES, len(present))
    return tuple(present[i] for i in np.linspace(0, len(present) - 1, count).astype(int))


def _unverified(folders: FitFolders) -> FitChoice:
    """The fit of a tree without vertices: by its folder's name."""
    pose_blend = folders.parameters != "params"
    sentence = (
        f"{folders.vertices}/ is missing: fits are {folders.parameters}, unverified, taken to be "
        f"made {'with' if pose_blend else 'without'} pose blend shapes."
    )
    return FitChoice(folders, pose_blend, sentence, (Finding("warning", "fits", sentence),))
