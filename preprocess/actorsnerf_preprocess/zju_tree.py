"""The files of one ZJU-MoCap tree: which variant, which picture and masks of each pair."""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal

from actorsnerf_preprocess.source import Finding, SourceError
from actorsnerf_preprocess.zju_annotations import Annotations, read_annotations
from actorsnerf_preprocess.zju_masks import Listing, MaskSet, lost_masks, mask_sets, user_masks

Variant = Literal["classic-23", "classic-21", "renamed-21", "refined", "easymocap"]
VARIANT_LINES: dict[Variant, str] = {
    "classic-23": "classic tree, folders Camera_B<n>",
    "classic-21": "classic tree, folders Camera (<n>), time-stamped names, fits from 1",
    "renamed-21": "classic tree, folders Camera (<n>), names shortened to the frame number",
    "refined": "refined tree (my_<id>), folders images/<nn>, recalibrated cameras and fits",
    "easymocap": "custom tree made with EasyMocap, folders images/<name>",
}
"""What the user reads, and the file's `variant`."""

ANNOTATION_NAMES = ("annots_new.npy", "annots.npy")
LONG_NAME = re.compile(r"\)_(\d{4})_")
"""CoreView_313_Camera_(1)_0001_2019-08-23_16-08-50.592.jpg: the frame number."""
LAST_DIGITS = re.compile(r"(\d+)\D*$")
SUBJECT_396 = "396"
FRAMES_396 = range(810, 1350)
"""Frames of subject 396 that the published experiments use; its masks are incomplete."""


@dataclass(frozen=True)
class ZjuTree:
    """One sequence's files on disk, matched to its annotations."""

    root: Path
    variant: Variant
    annotations: Annotations
    annotation_file: Path
    camera_names: tuple[str, ...]
    frames: tuple[int, ...]
    """Frame numbers, ascending."""
    pictures: dict[tuple[int, int], str]
    """(camera index, frame position) to the path below `root`; listed files, existing or not."""
    existing: frozenset[tuple[int, int]]
    mask_sets: tuple[MaskSet, ...]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]


def subject_of(name: str) -> str:
    """The subject in a folder's name: what follows `CoreView_` or `my_`, or the name itself.

    >>> subject_of("CoreView_387"), subject_of("my_377"), subject_of("387"), subject_of("aunt")
    ('387', '377', '387', 'aunt')
    """
    match = re.fullmatch(r"(?:CoreView|my|zju)[_-](.+)", name, re.IGNORECASE)
    return match[1] if match else name


def is_zju_tree(path: Path) -> bool:
    """Whether a folder has the annotations of a ZJU-MoCap sequence."""
    return any((path / name).is_file() for name in ANNOTATION_NAMES)


def read_tree(root: Path, masks: Path | None) -> ZjuTree:
    """The files of the sequence in a folder.

    Args:
        root: the folder with `annots.npy`.
        masks: the user's own mask folder, used in place of the source's masks.

    Raises:
        SourceError: no variant of the tree is recognised.
    """
    annotations, annotation_file, notes = _annotations(root)
    listing = Listing(root)
    listed = annotations.pictures or _found_pictures(root, annotations, listing)
    camera_names = tuple(PurePosixPath(name).parent.name for name in listed[0])
    if not annotations.pictures:
        notes.append(
            "No annotations list pictures: the folders belong to the cameras of "
            f"{annotation_file.name} in the order of their numbers: {', '.join(camera_names)}."
        )
    _check_names(annotation_file, listed, camera_names)
    variant = _variant(root, listed, listing)
    if variant == "renamed-21":
        listed = tuple(tuple(_short_name(name) for name in frame) for frame in listed)
        notes.append("Pictures were renamed to their frame number; annots.npy has the long names.")
    rows, frames, findings = _frames(root, listed)
    if subject_of(root.name) == SUBJECT_396 and frames[-1] >= FRAMES_396.start:
        kept = [i for i, number in enumerate(frames) if number in FRAMES_396]
        rows, frames = [rows[i] for i in kept], [frames[i] for i in kept]
        notes.append("Subject 396 is used from frame 810 to 1349, as in the published experiments.")
    pictures = {(c, f): name for f, row in enumerate(rows) for c, name in enumerate(row)}
    existing = frozenset(pair for pair, name in pictures.items() if listing.has(name))
    masks_found = user_masks(masks, root, pictures) if masks else mask_sets(pictures, listing)
    return ZjuTree(
        root=root,
        variant=variant,
        annotations=annotations,
        annotation_file=annotation_file,
        camera_names=camera_names,
        frames=tuple(frames),
        pictures=pictures,
        existing=existing,
        mask_sets=masks_found,
        findings=(
            *annotations.findings,
            *findings,
            *(lost_masks(root, listing) if variant == "renamed-21" else ()),
        ),
        notes=(*annotations.notes, *notes),
    )


def _annotations(root: Path) -> tuple[Annotations, Path, list[str]]:
    """Cameras of annots_new.npy if there is one, with the pictures of annots.npy if it has none."""
    present = [root / name for name in ANNOTATION_NAMES if (root / name).is_file()]
    if not present:
        raise SourceError(
            f"{root}: has neither annots.npy nor annots_new.npy: is this the folder of one "
            "sequence (CoreView_<id> or my_<id>)?"
        )
    annotations = read_annotations(present[0])
    if len(present) == 1 or annotations.pictures:
        return annotations, present[0], []
    older = read_annotations(present[1])
    if len(older.K) != len(annotations.K):
        raise SourceError(
            f"{present[0]}: has {len(annotations.K)} cameras, but {present[1].name}, which lists "
            f"the pictures, has {len(older.K)}."
        )
    merged = Annotations(
        annotations.K,
        annotations.distortion,
        annotations.R,
        annotations.T,
        older.pictures,
        older.findings,
        annotations.notes,
    )
    return merged, present[0], ["Cameras are those of annots_new.npy, picture paths of annots.npy."]


def _found_pictures(
    root: Path, annotations: Annotations, listing: Listing
) -> tuple[tuple[str, ...], ...]:
    """The pictures on disk, where no annotations list them."""
    base = "images" if listing.names("images") else "."
    folders = [f"{base}/{name}" for name in sorted(listing.names(base), key=_by_numbers)]
    folders = [folder for folder in folders if _pictures_in(listing.names(folder))]
    if len(folders) != len(annotations.K):
        raise SourceError(
            f"{root}: annots.npy lists no pictures, and {root / base} has {len(folders)} folders "
            f"of pictures for {len(annotations.K)} cameras: copy annots.npy of the original "
            "archive beside it."
        )
    names = sorted(set.intersection(*(set(_pictures_in(listing.names(f))) for f in folders)))
    if not names:
        first = [f"{folder}/{min(_pictures_in(listing.names(folder)))}" for folder in folders[:2]]
        raise SourceError(
            f"{root}: annots.npy lists no pictures, and no file name is in all {len(folders)} "
            f"folders of pictures ({', '.join(first)}), so it is unknown which belong together: "
            "copy annots.npy of the original archive beside it."
        )
    return tuple(tuple(f"{folder}/{name}" for folder in folders) for name in names)


def _by_numbers(name: str) -> tuple[tuple[int, ...], str]:
    """A sorting key: by the whole numbers in a name, and by the name where they are equal.

    >>> sorted(["Camera_B10", "Camera_B2", "Camera_B1"], key=_by_numbers)
    ['Camera_B1', 'Camera_B2', 'Camera_B10']
    """
    return tuple(int(number) for number in re.findall(r"\d+", name)), name


def _pictures_in(names: Iterable[str]) -> list[str]:
    return [name for name in names if name.lower().endswith((".jpg", ".jpeg", ".png"))]


def _check_names(
    annotation_file: Path, listed: tuple[tuple[str, ...], ...], camera_names: tuple[str, ...]
) -> None:
    repeated = [name for name, count in Counter(camera_names).items() if count > 1]
    if repeated:
        raise SourceError(
            f"{annotation_file}: two cameras of ims[0] have pictures in one folder {repeated[0]!r}."
        )
    for position, frame in enumerate(listed):
        names = tuple(PurePosixPath(name).parent.name for name in frame)
        if names != camera_names:
            raise SourceError(
                f"{annotation_file}: ims[{position}] lists the cameras in another order than "
                f"ims[0] ({_first_difference(names, camera_names)}): were cameras swapped when "
                "it was written?"
            )


def _first_difference(found: tuple[str, ...], expected: tuple[str, ...]) -> str:
    pair = next((a, b) for a, b in zip(found, expected, strict=True) if a != b)
    return f"{pair[0]!r} in place of {pair[1]!r}"


def _variant(root: Path, listed: tuple[tuple[str, ...], ...], listing: Listing) -> Variant:
    first = listed[0][0]
    if first.startswith("images/"):
        refined = listing.names("smpl_params") or root.name.startswith("my_")
        return "refined" if refined else "easymocap"
    if "Camera (" in first and LONG_NAME.search(first):
        sample = [name for frame in listed[:20] for name in frame]
        long_names = sum(listing.has(name) for name in sample)
        short_names = sum(listing.has(_short_name(name)) for name in sample)
        return "renamed-21" if short_names > long_names else "classic-21"
    if "Camera (" in first:
        return "renamed-21"
    return "classic-23" if "Camera_B" in first else "easymocap"


def _short_name(name: str) -> str:
    path = PurePosixPath(name)
    match = LONG_NAME.search(path.name)
    return str(path.with_name(match[1] + path.suffix)) if match else name


def _frames(
    root: Path, listed: tuple[tuple[str, ...], ...]
) -> tuple[list[tuple[str, ...]], list[int], list[Finding]]:
    """The rows of `listed` in ascending order of their frame numbers."""
    numbered: dict[int, tuple[str, ...]] = {}
    unequal = 0
    for row in listed:
        numbers = {_frame_number(root, name) for name in row}
        unequal += len(numbers) > 1
        number = _frame_number(root, row[0])
        if number in numbered:
            raise SourceError(f"{root}: annots.npy lists frame {number} twice.")
        numbered[number] = row
    frames = sorted(numbered)
    findings = []
    if unequal:
        sentence = f"{unequal} frames name pictures of different frame numbers; camera 1 counts."
        findings.append(Finding("warning", "annots.npy/ims", sentence))
    return [numbered[number] for number in frames], frames, findings


def _frame_number(root: Path, name: str) -> int:
    stem = PurePosixPath(name).stem
    match = LONG_NAME.search(name) or LAST_DIGITS.search(stem)
    if not match:
        raise SourceError(f"{root}: the picture {name!r} of annots.npy has no frame number.")
    return int(match[1])
