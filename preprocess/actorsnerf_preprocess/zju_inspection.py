"""What can be said about a ZJU-MoCap tree before any body model is needed."""

import hashlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.image_files import PictureFiles, picture_size
from actorsnerf_preprocess.source import Finding, Found, OpenOptions, SourceCamera, SourceError
from actorsnerf_preprocess.zju_annotations import world_up
from actorsnerf_preprocess.zju_choice import fit_folders
from actorsnerf_preprocess.zju_intrinsics import RELEASED_SIZE, intrinsics_of
from actorsnerf_preprocess.zju_masks import MaskSet
from actorsnerf_preprocess.zju_tree import VARIANT_LINES, ZjuTree, read_tree


@dataclass(frozen=True)
class ZjuInspection:
    """All that can be said about a sequence without a body model."""

    tree: ZjuTree
    cameras: tuple[SourceCamera, ...]
    world_up: Float64
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    def picture_files(self, camera: int, position: int) -> PictureFiles:
        """Where the picture of a camera and a position in `tree.frames` is."""
        pair = (camera, position)
        sets = [s for s in self.tree.mask_sets if pair in s.files]
        masks = tuple(s.files[pair] for s in sets)
        return PictureFiles(self.tree.pictures[pair], masks, any(s.given for s in sets))


def inspect_zju(found: Found, options: OpenOptions) -> ZjuInspection:
    """The cameras and files of a sequence, and what is wrong with them.

    Raises:
        SourceError: the annotations cannot be right, or there are no pictures at all.
    """
    tree = read_tree(found.path, options.masks)
    cameras, camera_findings, camera_notes = _cameras(tree)
    findings = (
        *tree.findings,
        *camera_findings,
        *_picture_findings(tree),
        *_mask_findings(tree),
        *_spare_findings(tree),
    )
    up = world_up(np.stack([camera.R for camera in cameras]))
    notes = (
        f"Variant: {VARIANT_LINES[tree.variant]}.",
        *tree.notes,
        *camera_notes,
        f"World up {np.round(up, 3).tolist()} is minus the cameras' mean image-down direction.",
        *mask_notes(tree.mask_sets),
    )
    return ZjuInspection(tree, cameras, up, findings, notes)


def facts(seen: ZjuInspection) -> tuple[tuple[str, str], ...]:
    """The lines that a user reads about a tree."""
    tree = seen.tree
    sizes = Counter(camera.size for camera in seen.cameras)
    distances = [float(np.linalg.norm(camera.T)) for camera in seen.cameras]
    distortion = max(float(np.abs(camera.distortion).max()) for camera in seen.cameras)
    listed = len(tree.pictures)
    return (
        ("variant", VARIANT_LINES[tree.variant]),
        ("cameras", f"{len(seen.cameras)}: {_shortened(tree.camera_names)}"),
        ("picture size", ", ".join(f"{w} x {h}" for w, h in sizes)),
        ("frames", f"{len(tree.frames)}: {tree.frames[0]} to {tree.frames[-1]}"),
        ("pictures", f"{len(tree.existing)} of {listed} listed are there"),
        ("masks", mask_source(tree.mask_sets) or "none"),
        *((s.name, f"{len(s.files)} of {listed}") for s in tree.mask_sets),
        ("fits", ", ".join(f.parameters for f in fit_folders(tree.root)) or "none"),
        ("camera |T|", f"{min(distances):.2f} to {max(distances):.2f} m"),
        ("distortion", f"largest coefficient {distortion:.3f}"),
        ("world up", str(np.round(seen.world_up, 2).tolist())),
    )


def mask_source(sets: tuple[MaskSet, ...]) -> str:
    """How the masks were made, for the file; empty if there are none.

    >>> mask_source((MaskSet("mask", {}), MaskSet("mask_cihp", {})))
    'union of the source folders mask, mask_cihp; not zero = person'
    """
    if not sets:
        return ""
    names = ", ".join(s.name for s in sets)
    if all(s.given for s in sets):
        return f"given by the user ({names}); levels or alpha = the person's share"
    kind = f"union of the source folders {names}" if len(sets) > 1 else f"source folder {names}"
    return f"{kind}; not zero = person"


def mask_notes(sets: tuple[MaskSet, ...]) -> tuple[str, ...]:
    """The sentence about the rule by which masks were read."""
    if not sets:
        return ()
    return (
        f"Masks: {mask_source(sets)}; undistorted bilinearly like the pictures, so the silhouette "
        "is soft, and no border is marked as unknown.",
    )


def source_digests(root: Path, names: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """(path below root, SHA-256) of files, and of folders over the names and bytes in them."""
    digests = []
    for name in names:
        path = root / name
        files = sorted(path.glob("*.npy")) if path.is_dir() else [path]
        digest = hashlib.sha256()
        for file in files:
            digest.update(file.name.encode() + b"\0")
            digest.update(hashlib.sha256(file.read_bytes()).digest())
        whole = digest.hexdigest()
        if not path.is_dir():
            whole = hashlib.sha256(path.read_bytes()).hexdigest()
        digests.append((name + "/" if path.is_dir() else name, whole))
    return tuple(digests)


def _cameras(
    tree: ZjuTree,
) -> tuple[tuple[SourceCamera, ...], list[Finding], tuple[str, ...]]:
    names = tree.camera_names
    found = [_size(tree, index) for index in range(len(names))]
    # Often only the protocol's cameras are downloaded; a stage's cameras are alike.
    usual = next((size for size in found if size), RELEASED_SIZE)
    sentence = f"No picture of this camera is readable; {usual[0]} x {usual[1]} is assumed."
    findings = [
        Finding("warning", name, sentence)
        for name, size in zip(names, found, strict=True)
        if size is None
    ]
    sizes = [size or usual for size in found]
    intrinsics = intrinsics_of(tree.annotations.K, sizes, names)
    cameras = [
        SourceCamera(
            name=name,
            source_index=index,
            K=intrinsics.K[index],
            distortion=tree.annotations.distortion[index],
            R=tree.annotations.R[index],
            T=tree.annotations.T[index],
            size=sizes[index],
        )
        for index, name in enumerate(names)
    ]
    if all(not any(pair[0] == c for pair in tree.existing) for c in range(len(cameras))):
        first = tree.root / next(iter(tree.pictures.values()))
        raise SourceError(
            f"{tree.root}: none of the {len(tree.pictures)} pictures that annots.npy lists is "
            f"there (first: {first}): were the camera folders downloaded?"
        )
    return tuple(cameras), [*findings, *intrinsics.findings], intrinsics.notes


def _size(tree: ZjuTree, camera: int) -> tuple[int, int] | None:
    for position in range(len(tree.frames)):
        if (camera, position) in tree.existing:
            size = picture_size(tree.root / tree.pictures[camera, position])
            if size:
                return size
    return None


def _picture_findings(tree: ZjuTree) -> list[Finding]:
    missing = sorted(set(tree.pictures) - tree.existing)
    if not missing:
        return []
    per_camera = Counter(tree.camera_names[camera] for camera, _ in missing)
    frames = sorted({tree.frames[position] for _, position in missing})
    sentence = (
        f"{len(missing)} of {len(tree.pictures)} listed pictures are missing: "
        f"{_counts(per_camera)}; frames {_shortened(tuple(map(str, frames)))}."
    )
    return [Finding("warning", "pictures", sentence)]


def _mask_findings(tree: ZjuTree) -> list[Finding]:
    if not tree.mask_sets:
        sentence = "No masks: looked for mask/, mask_cihp/ and schp/; give your own with --masks."
        return [Finding("error", "masks", sentence)]
    findings = []
    for masks in tree.mask_sets:
        missing = sorted(tree.existing - set(masks.files))
        if missing:
            per_camera = Counter(tree.camera_names[camera] for camera, _ in missing)
            sentence = f"{len(missing)} of {len(tree.existing)} pictures have no file here: "
            sentence += _counts(per_camera) + "."
            findings.append(Finding("warning", masks.name, sentence))
    if len(tree.mask_sets) == 1 and tree.mask_sets[0].name in ("mask", "mask_cihp"):
        other = {"mask": "mask_cihp", "mask_cihp": "mask"}[tree.mask_sets[0].name]
        findings.append(
            Finding("note", other, f"Not there; {tree.mask_sets[0].name} alone is used.")
        )
    return findings


def _spare_findings(tree: ZjuTree) -> list[Finding]:
    """Folders and files that look relevant and are not used."""
    findings = []
    base = tree.root / PurePosixPath(tree.pictures[0, 0]).parent.parent
    folders = {p.name for p in base.glob("Camera*") if p.is_dir()}
    unknown = sorted(folders - set(tree.camera_names))
    if unknown:
        sentence = f"Folders without camera parameters are not used: {', '.join(unknown)}."
        findings.append(Finding("note", "cameras", sentence))
    if (tree.root / "extri.yml").is_file():
        sentence = "intri.yml and extri.yml are not read; the cameras are those of annots.npy."
        findings.append(Finding("note", "extri.yml", sentence))
    if tree.variant == "classic-23" and "Camera_B6" in tree.camera_names:
        sentence = "The recording pipeline names this camera's synchronisation: look at it once."
        findings.append(Finding("note", "Camera_B6", sentence))
    return findings


def _counts(counts: Counter[str]) -> str:
    return _shortened(tuple(f"{name} {count}" for name, count in counts.items()))


def _shortened(names: tuple[str, ...]) -> str:
    return ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:3])}, ... {names[-1]}"
