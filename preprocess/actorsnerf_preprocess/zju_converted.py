"""Trees that HumanNeRF or ActorsNeRF prepared, read back as sources and marked as converted.

Their pictures are raw: distorted, whole, not masked. Betas are not in these trees; they are found
again from the rest joints, which depend on them linearly. ActorsNeRF's AIST++ trees have rest
joints that are shifted from frame to frame; the shift is found too and moved to where it belongs.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.body_model import BodyModel
from actorsnerf_datasets.pickles import load_pickle
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.image_files import PictureFiles, picture_size
from actorsnerf_preprocess.source import Finding, SourceCamera, SourceError
from actorsnerf_preprocess.zju_annotations import ROTATION_TOLERANCE
from actorsnerf_preprocess.zju_bodies import ReadFits, verified_fits
from actorsnerf_preprocess.zju_choice import FitChoice, FitFolders
from actorsnerf_preprocess.zju_fits import RawFit

EXACT_JOINTS = 1e-3
"""Metres: rest joints of the right body model are met to this."""
WRONG_JOINTS = 0.03
"""Metres: rest joints that are missed by more belong to another body model."""


@dataclass(frozen=True)
class ConvertedTree:
    """One prepared subject: one camera folder each, or the subject's folder as the only camera."""

    root: Path
    folders: tuple[str, ...]
    """Below `root`; `.` for a tree without a camera level."""
    cameras: tuple[SourceCamera, ...]
    frames: tuple[int, ...]
    fits: dict[int, Mapping[str, Float64]]
    """Frame number to Rh, Th, poses, joints, tpose_joints."""
    existing: frozenset[tuple[int, int]]
    """(camera index, frame position) of the pictures that are there."""
    findings: tuple[Finding, ...]

    def picture_files(self, camera: int, frame: int) -> PictureFiles:
        """Where the picture of a camera and a frame number is."""
        folder = self.folders[camera]
        name = f"frame_{frame:06d}.png"
        return PictureFiles(f"{folder}/images/{name}", (f"{folder}/masks/{name}",))


def is_converted_tree(path: Path) -> bool:
    """Whether a folder has the pickles of a prepared subject, at its top or per camera."""
    return (path / "mesh_infos.pkl").is_file() or (path / "0" / "mesh_infos.pkl").is_file()


def read_converted_tree(root: Path) -> ConvertedTree:
    """The cameras, fits and files of a prepared subject.

    Raises:
        SourceError: a pickle lacks an entry, a camera moves, or no picture is readable at all.
    """
    folders: tuple[str, ...] = (".",)
    if not (root / "mesh_infos.pkl").is_file():
        numbered = [path for path in root.iterdir() if path.name.isdigit() and path.is_dir()]
        folders = tuple(path.name for path in sorted(numbered, key=lambda path: int(path.name)))
    fits = _fits(root / folders[0] / "mesh_infos.pkl")
    frames = tuple(sorted(fits))
    sizes = [_size(root / folder) for folder in folders]
    some = next((size for size in sizes if size), None)
    if some is None:
        first = root / folders[0] / "images"
        raise SourceError(f"{first}: has no readable picture frame_<number>.png.")
    cameras, findings, existing = [], [], set()
    for index, (folder, size) in enumerate(zip(folders, sizes, strict=True)):
        camera = _camera(root / folder, index, size or some)
        cameras.append(camera)
        if size is None:
            # Often only the protocol's pictures are made; a stage's cameras are alike.
            sentence = f"No picture is readable; {some[0]} x {some[1]} is assumed."
            findings.append(Finding("warning", f"camera {camera.name}", sentence))
        images = {path.stem for path in (root / folder / "images").glob("frame_*.png")}
        missing = []
        for position, frame in enumerate(frames):
            if f"frame_{frame:06d}" in images:
                existing.add((index, position))
            else:
                missing.append(frame)
        if missing:
            sentence = f"{len(missing)} of {len(fits)} pictures are missing (first: {missing[0]})."
            findings.append(Finding("warning", f"camera {camera.name}", sentence))
    return ConvertedTree(
        root, folders, tuple(cameras), frames, fits, frozenset(existing), tuple(findings)
    )


def converted_facts(tree: ConvertedTree) -> tuple[tuple[str, str], ...]:
    """The lines that a user reads about a converted subject."""
    sizes = sorted({camera.size for camera in tree.cameras})
    vertices = vertices_root(tree.root)
    return (
        ("cameras", str(len(tree.cameras))),
        ("picture size", ", ".join(f"{width} x {height}" for width, height in sizes)),
        ("frames", f"{len(tree.frames)}: {tree.frames[0]} to {tree.frames[-1]}"),
        ("pictures", f"{len(tree.existing)} of {len(tree.cameras) * len(tree.frames)} are there"),
        ("vertices", str(vertices / "new_vertices") if vertices else "none, will be rebuilt"),
    )


def vertices_root(root: Path) -> Path | None:
    """The folder with `new_vertices`: the subject's, or the one above, as its README draws it."""
    return next((place for place in (root, root.parent) if (place / "new_vertices").is_dir()), None)


def converted_fits(
    tree: ConvertedTree, frames: tuple[int, ...], model: BodyModel
) -> tuple[ReadFits, tuple[Finding, ...]]:
    """The fits of the given frames with betas found again, and what that search says.

    Raises:
        SourceError: the rest joints are not those of the body model, whatever the betas.
    """
    raw, residuals, shifts = [], [], []
    for frame in frames:
        fit, residual, shift = _raw_fit(tree.fits[frame], model)
        raw.append(fit)
        residuals.append(residual)
        shifts.append(shift)
    worst = max(residuals)
    if worst > WRONG_JOINTS:
        raise SourceError(
            f"{tree.root / tree.folders[0] / 'mesh_infos.pkl'}: rest joints differ from those of "
            f"the body model by {1000 * worst:.0f} mm for any shape, expected below "
            f"{1000 * EXACT_JOINTS:.0f} mm: was the tree made with another body model (male)?"
        )
    findings = []
    if worst > EXACT_JOINTS:
        sentence = f"Rest joints differ from the body model's by up to {1000 * worst:.1f} mm."
        findings.append(Finding("warning", "mesh_infos.pkl", sentence))
    sentence = f"Betas were found from the rest joints, to {1000 * worst:.2g} mm."
    if max(shifts) > EXACT_JOINTS:
        sentence += (
            f" Rest joints were shifted by up to {100 * max(shifts):.1f} cm; this is undone."
        )
    place = vertices_root(tree.root) or tree.root
    choice = FitChoice(FitFolders("mesh_infos.pkl", "new_vertices"), True, sentence, ())
    return verified_fits(place, frames, raw, choice, model), tuple(findings)


def _fits(path: Path) -> dict[int, Mapping[str, Float64]]:
    content = load_pickle(path)
    if not isinstance(content, Mapping) or not content:
        raise SourceError(
            f"{path}: expected a dictionary of frames, found {type(content).__name__}."
        )
    sizes = {"Rh": 3, "Th": 3, "poses": 72, "joints": 72, "tpose_joints": 72}
    fits: dict[int, Mapping[str, Float64]] = {}
    for name, entry in content.items():
        number = str(name).removeprefix("frame_")
        if not number.isdigit() or not isinstance(entry, Mapping):
            raise SourceError(f"{path}: entry {name!r} is not a frame such as 'frame_000000'.")
        fits[int(number)] = {
            key: _vector(path, str(name), entry, key, n) for key, n in sizes.items()
        }
    return fits


def _vector(path: Path, name: str, entry: Mapping[str, object], key: str, size: int) -> Float64:
    values = np.asarray(entry.get(key, ()), np.float64).ravel()
    if values.size != size or not np.isfinite(values).all():
        raise SourceError(
            f"{path}: {name}/{key} should hold {size} finite numbers, found {values.size}."
        )
    return values


def _size(folder: Path) -> tuple[int, int] | None:
    """Width and height of a camera's pictures; None if none is readable."""
    pictures = sorted((folder / "images").glob("frame_*.png"))
    return next((size for picture in pictures if (size := picture_size(picture))), None)


def _camera(folder: Path, index: int, size: tuple[int, int]) -> SourceCamera:
    """The static camera of a folder's `cameras.pkl`."""
    path = folder / "cameras.pkl"
    content = load_pickle(path)
    if not isinstance(content, Mapping) or not content:
        raise SourceError(
            f"{path}: expected a dictionary of frames, found {type(content).__name__}."
        )
    sizes = {"intrinsics": 9, "extrinsics": 16}
    entries = []
    for name, entry in content.items():
        if not isinstance(entry, Mapping):
            raise SourceError(f"{path}: entry {name!r} is not a camera.")
        numbers = [_vector(path, str(name), entry, key, size) for key, size in sizes.items()]
        lens = np.asarray(entry.get("distortions", np.zeros(5)), np.float64).ravel()
        entries.append(np.concatenate((*numbers, np.pad(lens, (0, max(0, 5 - lens.size)))[:5])))
    first = entries[0]
    if any(not np.allclose(entry, first, atol=1e-4) for entry in entries):
        raise SourceError(f"{path}: the camera moves from frame to frame; only static cameras fit.")
    extrinsics = first[9:25].reshape(4, 4)
    R = extrinsics[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise SourceError(f"{path}: the rotation of 'extrinsics' is not a right-handed rotation.")
    name = folder.name if folder.name.isdigit() and index else str(index)
    return SourceCamera(
        name, index, first[:9].reshape(3, 3), first[25:], R, extrinsics[:3, 3].copy(), size
    )


def _raw_fit(entry: Mapping[str, Float64], model: BodyModel) -> tuple[RawFit, float, float]:
    """The fit with its betas, the residual of the rest joints, and their shift, metres."""
    rest_joints = entry["tpose_joints"].reshape(24, 3)
    mean = model.joint_regressor @ model.template
    directions = np.einsum("jv,vkb->jkb", model.joint_regressor, model.shape_directions)
    count = directions.shape[-1]
    system = directions.reshape(72, count)
    betas, residual = _least_squares(system, (rest_joints - mean).ravel())
    shift = np.zeros(3)
    if residual > EXACT_JOINTS:
        shifted = np.hstack((system, np.tile(np.eye(3), (24, 1))))
        solution, residual = _least_squares(shifted, (rest_joints - mean).ravel())
        betas, shift = solution[:count], solution[count:]
    # Their body frame is ours moved by the shift: R (x + shift) + Th = R x + (Th + R shift).
    Th = entry["Th"] + matrix_from_axis_angle(entry["Rh"]) @ shift
    fit = RawFit(entry["poses"].reshape(24, 3), entry["Rh"], Th, betas, padded=False)
    return fit, residual, float(np.linalg.norm(shift))


def _least_squares(system: Float64, target: Float64) -> tuple[Float64, float]:
    """The solution and the largest distance of a joint from its target, metres."""
    solution = np.linalg.lstsq(system, target, rcond=1e-8)[0].astype(np.float64)
    missed = (system @ solution - target).reshape(24, 3)
    return solution, float(np.linalg.norm(missed, axis=1).max())
