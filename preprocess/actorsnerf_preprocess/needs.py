"""Which files a sequence's protocol needs, which of them are missing, and where they come from."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.protocols import needed_pairs
from actorsnerf_preprocess.aist import needed_cameras
from actorsnerf_preprocess.aist_annotations import read_motion
from actorsnerf_preprocess.aist_inspection import chosen_frames
from actorsnerf_preprocess.aist_names import video_name
from actorsnerf_preprocess.aist_tree import find_tree
from actorsnerf_preprocess.source import Found, OpenOptions, SourceError
from actorsnerf_preprocess.zju_choice import CANDIDATES, fit_folders
from actorsnerf_preprocess.zju_converted import is_converted_tree, read_converted_tree
from actorsnerf_preprocess.zju_fits import fit_file
from actorsnerf_preprocess.zju_protocol import protocol_of, wanted_pairs
from actorsnerf_preprocess.zju_tree import is_zju_tree, read_tree

ORIGINS = (
    "ZJU-MoCap: on request from its authors (github.com/zju3dv/neuralbody, INSTALL.md): per "
    "sequence annots.npy, new_params/, new_vertices/, mask_cihp/, mask/, the camera folders.",
    "AIST++: annotations (CC BY 4.0) from google.github.io/aistplusplus_dataset; videos, after "
    "accepting the terms, from aistdancedb.ongaaccel.jp (10M or 2M versions).",
    "Trees of HumanNeRF and ActorsNeRF: made from those downloads by these projects' own scripts; "
    "per camera cameras.pkl, mesh_infos.pkl, images/ and masks/.",
    "Body models: register at smplify.is.tue.mpg.de (neutral, for ZJU-MoCap) and "
    "smpl.is.tue.mpg.de (male, for AIST++).",
)
"""One line per data set, for the user."""


@dataclass(frozen=True)
class Need:
    """A kind of file that a sequence needs."""

    what: str
    needed: int
    missing: tuple[Path, ...]
    which: tuple[str, ...] = ()
    """What is needed, in lines for the user."""


def needs_of(found: Found, options: OpenOptions) -> tuple[Need, ...]:
    """What a sequence's protocol needs, and what of it is missing.

    Raises:
        SourceError: the annotations cannot be read.
    """
    if is_zju_tree(found.path):
        return _zju_needs(found, options)
    if is_converted_tree(found.path):
        return _converted_needs(found, options)
    return _aist_needs(found, options)


def need_lines(found: Found, needs: tuple[Need, ...]) -> list[str]:
    """What a sequence needs, as lines for the user."""
    lines = [f"{found.name}:"]
    for need in needs:
        lines.append(f"  {need.what}: {need.needed} needed, {len(need.missing)} missing")
        lines += [f"    {line}" for line in need.which]
        per_folder = Counter(str(path.parent) for path in need.missing)
        for folder, count in list(per_folder.items())[:5]:
            first = next(path.name for path in need.missing if str(path.parent) == folder)
            lines.append(f"    {folder}: {count} missing, first {first}")
        if len(per_folder) > 5:
            lines.append(f"    ... and {len(per_folder) - 5} more folders")
    return lines


def _zju_needs(found: Found, options: OpenOptions) -> tuple[Need, ...]:
    """Pictures, masks and fits."""
    tree = read_tree(found.path, options.masks)
    protocol = protocol_of(found, options, tree.camera_names, tree.frames)
    pairs = needed_pairs(protocol)
    wanted = [
        (camera, position)
        for camera, name in enumerate(tree.camera_names)
        for position, frame in enumerate(tree.frames)
        if options.pairs == "all" or (name, frame) in pairs
    ]
    pictures = [tree.root / tree.pictures[pair] for pair in wanted if pair not in tree.existing]
    masked = {pair for masks in tree.mask_sets for pair in masks.files}
    masks = [tree.root / "mask_cihp" / tree.pictures[p] for p in wanted if p not in masked]
    frames = sorted({tree.frames[position] for _, position in wanted})
    which = _which(
        {
            name: tuple(tree.frames[position] for each, position in wanted if each == camera)
            for camera, name in enumerate(tree.camera_names)
        }
    )
    folders = (*fit_folders(tree.root), CANDIDATES[0])[0]
    fits = [
        tree.root / folders.parameters / f"{frame}.npy"
        for frame in frames
        if fit_file(tree.root / folders.parameters, frame) is None
    ]
    return (
        Need("pictures", len(wanted), tuple(pictures), which),
        Need("masks", len(wanted), tuple(path.with_suffix(".png") for path in masks)),
        Need(f"fits ({folders.parameters})", len(frames), tuple(fits)),
    )


def _converted_needs(found: Found, options: OpenOptions) -> tuple[Need, ...]:
    """Pictures and masks, and the pickles, without which nothing more can be said."""
    tree = read_converted_tree(found.path)
    names = tuple(camera.name for camera in tree.cameras)
    protocol = protocol_of(found, options, names, tree.frames)
    wanted = np.argwhere(wanted_pairs(protocol, options, names, tree.frames)).tolist()
    files = [tree.picture_files(camera, tree.frames[position]) for camera, position in wanted]
    images = [tree.root / each.image for each in files]
    masks = [tree.root / name for each in files for name in each.masks]
    which = _which(
        {
            f"camera {name}": tuple(tree.frames[f] for c, f in wanted if c == index)
            for index, name in enumerate(names)
        }
    )
    return (
        Need("pictures", len(images), tuple(path for path in images if not path.is_file()), which),
        Need("masks", len(masks), tuple(path for path in masks if not path.is_file())),
        Need("cameras (cameras.pkl)", len(tree.folders), ()),
        Need("fits (mesh_infos.pkl)", 1, ()),
    )


def _aist_needs(found: Found, options: OpenOptions) -> tuple[Need, ...]:
    """The videos of the protocol's cameras: for pre-training, that of the first alone.

    Raises:
        SourceError: the motion cannot be read.
    """
    tree = find_tree(found.path)
    if tree is None:
        raise SourceError(f"{found.path}: there are no AIST++ annotations below it.")
    frames, _ = chosen_frames(len(read_motion(tree.motions / f"{found.name}.pkl").poses))
    there = tree.videos.get(found.name, {})
    cameras = needed_cameras(found.name, options, frames)
    names = {camera: f"{video_name(found.name, camera)}.mp4" for camera in cameras}
    missing = tuple(found.path / name for camera, name in names.items() if camera not in there)
    return (Need("videos", len(names), missing, tuple(names.values())),)


def _which(frames: dict[str, tuple[int, ...]]) -> tuple[str, ...]:
    """The frames that each camera needs; cameras that need the same share a line.

    >>> _which({"B1": (0, 1, 2), "B2": (30, 40), "B3": (30, 40), "B4": ()})
    ('B1: 3 frames, 0 to 2', 'B2 to B3: 2 frames each, 30, 40')
    """
    groups: dict[tuple[int, ...], list[str]] = {}
    for name, numbers in frames.items():
        groups.setdefault(numbers, []).append(name)
    lines = []
    for numbers, names in groups.items():
        if not numbers:
            continue
        whole = numbers == tuple(range(numbers[0], numbers[-1] + 1))
        listed = f"{numbers[0]} to {numbers[-1]}" if whole else ", ".join(map(str, numbers))
        cameras = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
        each = "" if len(names) == 1 else " each"
        lines.append(f"{cameras}: {len(numbers)} frame{'s'[: len(numbers) > 1]}{each}, {listed}")
    return tuple(lines)
