"""Masks that the user gives: pictures in a folder per camera, or one video per camera."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.aist_video import picture_per_frame
from actorsnerf_preprocess.mask_files import given_mask
from actorsnerf_preprocess.source import Absent

_PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff")
_VIDEOS = (".mp4", ".mkv", ".avi", ".mov", ".webm")
_NUMBER = re.compile(r"(\d+)$")


@dataclass(frozen=True)
class GivenMasks:
    """The masks of one camera: one picture per frame number, or a video."""

    pictures: dict[int, Path]
    """Frame number -> file; empty if there is a video."""
    video: Path | None
    size: tuple[int, int]
    """Width, height that a mask must have."""

    def files(self, frame: int) -> tuple[Path, ...]:
        """Where the mask of a frame is."""
        if self.video is not None:
            return (self.video,)
        return (self.pictures[frame],) if frame in self.pictures else ()

    def read_each(self, frames: Sequence[int]) -> Iterator[UInt8 | Absent | None]:
        """The mask of each frame (ascending), (H, W) 0 to 255; None where none is given.

        Pictures are read as `given_mask` says; of a video the brightest channel counts.
        """
        if self.video is not None:
            for picture in picture_per_frame(self.video, frames):
                yield None if picture is None else self._checked(_shares(picture), self.video)
            return
        for frame in frames:
            path = self.pictures.get(frame)
            yield None if path is None else self._checked(_read(path), path)

    def _checked(self, mask: UInt8 | Absent, where: Path) -> UInt8 | Absent:
        if isinstance(mask, Absent):
            return mask
        if mask.shape[::-1] != self.size:
            height, width = mask.shape
            return Absent(
                str(where),
                f"mask of {width} x {height} instead of {self.size[0]} x {self.size[1]}",
            )
        return mask


def find_given_masks(
    folder: Path | None, names: Sequence[str], size: tuple[int, int]
) -> GivenMasks | None:
    """The masks that a folder holds for one camera; None if it holds none.

    Args:
        folder: what the user named; None: nothing.
        names: what the camera may be called there, the first found counts: sub-folders `<name>`
            with one picture per frame (the number at the end of the file's name), or videos
            `<name>.mp4`, `<name>_alpha2.mp4`, `<name>_alpha1.mp4`, `<name>_alpha.mp4`.
        size: width and height of the camera's pictures.
    """
    if folder is None:
        return None
    for name in names:
        pictures = {
            int(number.group()): path
            for path in (sorted((folder / name).glob("*")) if (folder / name).is_dir() else [])
            if path.suffix.lower() in _PICTURES and (number := _NUMBER.search(path.stem))
        }
        if pictures:
            return GivenMasks(pictures, None, size)
        for ending in ("", "_alpha2", "_alpha1", "_alpha"):
            for kind in _VIDEOS:
                video = folder / f"{name}{ending}{kind}"
                if video.is_file():
                    return GivenMasks({}, video, size)
    return None


def _shares(picture: UInt8) -> UInt8:
    """The mask in a video's picture."""
    mask: UInt8 = picture.max(2)
    return np.where(mask > 0, np.uint8(255), np.uint8(0)) if mask.max() == 1 else mask


def _read(path: Path) -> UInt8 | Absent:
    try:
        content = path.read_bytes()
    except OSError as error:
        return Absent(str(path), f"cannot be read ({error.strerror})")
    return given_mask(content, str(path))
