"""Where the parts of an AIST++ download lie below a folder, however it was unpacked."""

import os
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from actorsnerf_preprocess.aist_names import sequence_of_video
from actorsnerf_preprocess.source import SourceError

MAX_DEPTH = 5
"""How many folders deep the parts are looked for."""
TRUTH = "truth"
"""Folder beside a synthetic tree with the generator's own knowledge; never read."""
_VIDEO_ENDINGS = (".mp4", ".mkv", ".avi", ".mov", ".webm")


@dataclass(frozen=True)
class AistTree:
    """The parts of one download."""

    root: Path
    cameras: Path
    """Folder with mapping.txt and the settings."""
    motions: Path
    keypoints2d: Path | None
    keypoints3d: Path | None
    ignore_list: Path | None
    videos: dict[str, dict[str, Path]]
    """Sequence -> camera -> file."""
    notes: tuple[str, ...]
    """Choices between several copies, a sentence each."""

    def sequences(self) -> tuple[str, ...]:
        """Names of the sequences with a motion, sorted."""
        return tuple(sorted(path.stem for path in self.motions.glob("*.pkl")))


def find_tree(root: Path) -> AistTree | None:
    """The parts below a folder; None if there are no AIST++ annotations.

    The annotations may lie in `root` itself, in `root/annotations`, or in the dated folders of the
    older packages (`20210308_motions/motions`); videos anywhere, flat or nested. Links to folders
    are followed. Of two copies the one whose path sorts last (the newer date) is taken and the
    choice noted; of two videos of a view the larger.

    Raises:
        SourceError: only one of cameras/ and motions/ is there.
    """
    parts: dict[str, list[Path]] = {}
    videos: dict[str, dict[str, Path]] = {}
    for folder, files in _walk(root):
        for kind in _kinds(folder, files):
            parts.setdefault(kind, []).append(folder)
        for name in files:
            if name.lower().endswith(_VIDEO_ENDINGS):
                _add_video(videos, folder / name)
    if "cameras" not in parts and "motions" not in parts:
        return None
    for kind, sign in (("cameras", "cameras/mapping.txt"), ("motions", "motions/*.pkl")):
        if kind not in parts:
            raise SourceError(
                f"{root}: there is no {sign} below it, up to {MAX_DEPTH} folders deep; download"
                " the AIST++ annotations (fullset.zip) and unpack them there."
            )
    chosen = {kind: sorted(folders)[-1] for kind, folders in parts.items()}
    return AistTree(
        root=root,
        cameras=chosen["cameras"],
        motions=chosen["motions"],
        keypoints2d=chosen.get("keypoints2d"),
        keypoints3d=chosen.get("keypoints3d"),
        ignore_list=chosen["ignore"] / "ignore_list.txt" if "ignore" in chosen else None,
        videos=videos,
        notes=tuple(
            f"{len(folders)} folders hold {kind}; taken: {chosen[kind].relative_to(root)}."
            for kind, folders in sorted(parts.items())
            if len(folders) > 1
        ),
    )


def _walk(root: Path) -> tuple[tuple[Path, list[str]], ...]:
    """Every folder with the names of its files, once, also behind links to folders.

    A folder that several ways lead to has the name that no link is in; a loop of links ends.
    """
    found: dict[Path, tuple[Path, list[str]]] = {}
    opened: set[Path] = set()
    waiting, linked = [(root, 0)], deque[tuple[Path, int]]()
    while waiting or linked:
        path, depth = waiting.pop() if waiting else linked.popleft()
        place = path.resolve()
        if place in opened:
            continue
        _, inner, files = next(os.walk(path), ("", [], []))
        found.setdefault(place, (path, sorted(files)))
        if depth == MAX_DEPTH:
            continue
        opened.add(place)
        for name in sorted(inner, reverse=True):
            if name != TRUTH and not (path / name).is_symlink():
                waiting.append((path / name, depth + 1))
        linked += [
            (path / name, depth + 1)
            for name in sorted(inner)
            if name != TRUTH and (path / name).is_symlink()
        ]
    return tuple(found.values())


def _kinds(folder: Path, files: list[str]) -> list[str]:
    kinds = []
    if "mapping.txt" in files:
        kinds.append("cameras")
    if "ignore_list.txt" in files:
        kinds.append("ignore")
    for kind in ("motions", "keypoints2d", "keypoints3d"):
        if folder.name == kind and any(name.endswith(".pkl") for name in files):
            kinds.append(kind)
    return kinds


def _add_video(videos: dict[str, dict[str, Path]], path: Path) -> None:
    view = sequence_of_video(path.stem)
    if view is None:
        return
    sequence, camera = view
    present = videos.setdefault(sequence, {}).get(camera)
    if present is None or path.stat().st_size > present.stat().st_size:
        videos[sequence][camera] = path
