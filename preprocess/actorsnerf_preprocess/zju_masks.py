"""The mask files of a ZJU-MoCap tree: which sets there are, and which pair has which file."""

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from actorsnerf_preprocess.source import Finding, SourceError


@dataclass(frozen=True)
class MaskSet:
    """One set of masks of the source."""

    name: str
    """mask, mask_cihp, schp, or the user's folder."""
    files: dict[tuple[int, int], str]
    """(camera index, frame position) to the path; only files that exist."""
    given: bool = False
    """The user's own."""


class Listing:
    """Which files exist below a folder; every folder is listed once."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._folders: dict[str, frozenset[str]] = {}

    def names(self, folder: str) -> frozenset[str]:
        """Names in a folder given below the root; none if it does not exist.

        Raises:
            SourceError: the folder may not be read.
        """
        if folder not in self._folders:
            path = self._root / folder
            try:
                names = [entry.name for entry in path.iterdir()] if path.is_dir() else []
            except OSError as error:
                raise SourceError(f"{path}: cannot be read ({error.strerror}).") from error
            self._folders[folder] = frozenset(names)
        return self._folders[folder]

    def has(self, relative: str) -> bool:
        """Whether a path given below the root exists."""
        folder, _, name = relative.rpartition("/")
        return name in self.names(folder)


def mask_sets(pictures: dict[tuple[int, int], str], listing: Listing) -> tuple[MaskSet, ...]:
    """The sets `mask` and `mask_cihp`; `schp` where both are missing."""
    sets = [_mask_set(name, pictures, listing) for name in ("mask", "mask_cihp")]
    found = tuple(masks for masks in sets if masks.files)
    if found:
        return found
    parts = _mask_set("schp", pictures, listing)
    return (parts,) if parts.files else ()


def _mask_set(folder: str, pictures: dict[tuple[int, int], str], listing: Listing) -> MaskSet:
    files = {}
    for pair, name in pictures.items():
        stem = name.rpartition(".")[0]
        # `images/00/000000.jpg` has its mask at mask/images/00/ or at mask/00/.
        inner = [stem, stem.removeprefix("images/")] if name.startswith("images/") else [stem]
        for candidate in [f"{folder}/{p}.{suffix}" for suffix in ("png", "jpg") for p in inner]:
            if listing.has(candidate):
                files[pair] = candidate
                break
    return MaskSet(folder, files)


def user_masks(
    masks: Path, root: Path, pictures: dict[tuple[int, int], str]
) -> tuple[MaskSet, ...]:
    """The user's own masks: `<masks>[/<sequence>]/<folder and name of the picture>.png`.

    Raises:
        SourceError: the folder does not exist or has no mask of any picture.
    """
    if not masks.is_dir():
        raise SourceError(f"{masks}: no such folder of masks.")
    base = masks / root.name if (masks / root.name).is_dir() else masks
    found = _mask_set(".", pictures, Listing(base))
    if not found.files:
        example = PurePosixPath(next(iter(pictures.values()))).with_suffix(".png")
        raise SourceError(
            f"{base}: has no mask of this sequence; expected files such as {base / example}."
        )
    absolute = {pair: str((base / name).resolve()) for pair, name in found.files.items()}
    return (MaskSet(str(masks), absolute, given=True),)


def lost_masks(root: Path, listing: Listing) -> list[Finding]:
    """Reports folders of `mask/` whose files were all renamed to one name, and so lost.

    A renaming script in circulation does that to mask/Camera (k).
    """
    lost = [
        name
        for name in sorted(listing.names("mask"))
        if (root / "mask" / name).is_dir() and len(listing.names(f"mask/{name}")) == 1
    ]
    if not lost:
        return []
    sentence = (
        f"{len(lost)} folders hold one file each (for example {lost[0]}): the renaming script that "
        "is in circulation overwrites these masks; take mask/ from the archive again."
    )
    return [Finding("warning", "mask/", sentence)]
