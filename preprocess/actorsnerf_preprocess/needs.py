"""Which files a sequence's protocol needs, which of them are missing, and where they come from."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.protocols import needed_pairs
from actorsnerf_preprocess.aist_names import video_name
from actorsnerf_preprocess.source import Found, OpenOptions
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


def needs_of(found: Found, options: OpenOptions) -> tuple[Need, ...]:
    """What a sequence's protocol needs, and what of it is missing.

    Raises:
        SourceError: the annotations cannot be read.
    """
    if is_zju_tree(found.path):
        return _zju_needs(found, options)
    return _converted_needs(found, options) if is_converted_tree(found.path) else _aist_needs(found)


def need_lines(found: Found, needs: tuple[Need, ...]) -> list[str]:
    """What a sequence needs, as lines for the user."""
    lines = [f"{found.name}:"]
    for need in needs:
        lines.append(f"  {need.what}: {need.needed} needed, {len(need.missing)} missing")
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
    folders = (*fit_folders(tree.root), CANDIDATES[0])[0]
    fits = [
        tree.root / folders.parameters / f"{frame}.npy"
        for frame in frames
        if fit_file(tree.root / folders.parameters, frame) is None
    ]
    return (
        Need("pictures", len(wanted), tuple(pictures)),
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
    return (
        Need("pictures", len(images), tuple(path for path in images if not path.is_file())),
        Need("masks", len(masks), tuple(path for path in masks if not path.is_file())),
        Need("cameras (cameras.pkl)", len(tree.folders), ()),
        Need("fits (mesh_infos.pkl)", 1, ()),
    )


def _aist_needs(found: Found) -> tuple[Need, ...]:
    """Videos of the cameras c01 to c08."""
    names = [video_name(found.name, f"c{number:02d}") for number in range(1, 9)]
    there = {path.name for path in found.path.rglob("*.mp4")}
    missing = tuple(Path(f"{name}.mp4") for name in names if f"{name}.mp4" not in there)
    return (Need("videos", len(names), missing),)
