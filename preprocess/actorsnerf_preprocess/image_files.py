"""Pictures and masks of a folder tree, one file each: a `SplitReader` of image files."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.mask_files import given_mask, person_mask
from actorsnerf_preprocess.source import Absent, MaskProbe, RawPicture

READ_FLAGS = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
"""Pixels as stored: a camera's K knows nothing of the orientation that a viewer would apply."""


@dataclass(frozen=True)
class PictureFiles:
    """Where one picture and its masks are, below the reader's root; masks may be absolute."""

    image: str
    masks: tuple[str, ...]
    given: bool = False
    """The masks are the user's and hold shares (`given_mask`); else what is not zero counts."""


class ImageReader:
    """Reads image files; of a picture's masks, each pixel's largest counts."""

    frames_per_task = 16

    def __init__(
        self,
        root: Path,
        files: dict[tuple[int, int], PictureFiles],
        sizes: tuple[tuple[int, int], ...],
    ) -> None:
        """A reader of the (camera index, frame index) pairs in `files`.

        Args:
            root: the sequence's folder.
            files: the pairs that may be asked for.
            sizes: width and height of each camera's pictures.
        """
        self._root = root
        self._files = files
        self._sizes = sizes

    def files(self, camera_index: int, frame_index: int) -> tuple[Path, ...]:
        """The picture's file, then its masks."""
        files = self._files[camera_index, frame_index]
        return tuple(self._root / name for name in (files.image, *files.masks))

    def probe(self, camera_index: int, frame_index: int) -> MaskProbe | Absent:
        """The mask, and a digest over the bytes of the picture and its masks."""
        paths = self.files(camera_index, frame_index)
        contents = _contents(paths)
        if isinstance(contents, Absent):
            return contents
        if len(paths) == 1:
            return Absent(str(paths[0]), "no mask")
        digest = hashlib.sha256()
        for content in contents:
            digest.update(content)
        mask = self._mask((camera_index, frame_index), paths, contents)
        return mask if isinstance(mask, Absent) else MaskProbe(mask, digest.hexdigest())

    def read_many(
        self, camera_index: int, frame_indices: Sequence[int]
    ) -> Iterator[RawPicture | Absent]:
        """One item per frame index, in order."""
        for frame_index in frame_indices:
            paths = self.files(camera_index, frame_index)
            contents = _contents(paths)
            if isinstance(contents, Absent):
                yield contents
                continue
            picture = self._picture(camera_index, paths[0], contents[0])
            mask = self._mask((camera_index, frame_index), paths, contents)
            if isinstance(picture, Absent):
                yield picture
            elif isinstance(mask, Absent):
                yield mask
            else:
                yield replace(picture, mask=mask)

    def read_images(
        self, camera_index: int, frame_indices: Sequence[int]
    ) -> Iterator[RawPicture | Absent]:
        """One item without a mask per frame index, in order."""
        for frame_index in frame_indices:
            path = self._root / self._files[camera_index, frame_index].image
            contents = _contents([path])
            if isinstance(contents, Absent):
                yield contents
            else:
                yield self._picture(camera_index, path, contents[0])

    def _picture(self, camera_index: int, path: Path, content: bytes) -> RawPicture | Absent:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), READ_FLAGS)
        if image is None:
            return Absent(str(path), "not a readable picture")
        size = self._sizes[camera_index]
        if image.shape[1::-1] != size:
            return Absent(str(path), f"{_by(image.shape[1::-1])} instead of {_by(size)}")
        return RawPicture(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8), None)

    def _mask(
        self, pair: tuple[int, int], paths: Sequence[Path], contents: list[bytes]
    ) -> UInt8 | Absent | None:
        size = self._sizes[pair[0]]
        given = self._files[pair].given
        union: UInt8 | None = None
        for path, content in zip(paths[1:], contents[1:], strict=True):
            mask = given_mask(content, str(path)) if given else person_mask(content)
            if mask is None:
                return Absent(str(path), "not a readable mask")
            if isinstance(mask, Absent):
                return mask
            found = (mask.shape[1], mask.shape[0])
            if found != size:
                if found[0] * size[1] != found[1] * size[0]:
                    return Absent(str(path), f"mask of {_by(found)} for a picture of {_by(size)}")
                method = cv2.INTER_AREA if given else cv2.INTER_NEAREST
                mask = np.asarray(cv2.resize(mask, size, interpolation=method), np.uint8)
            union = mask if union is None else np.asarray(cv2.max(union, mask), np.uint8)
        return union


def picture_size(path: Path) -> tuple[int, int] | None:
    """Width and height of an image file; None if it is not readable."""
    image = cv2.imread(str(path), READ_FLAGS)
    return None if image is None else (image.shape[1], image.shape[0])


def _contents(paths: Sequence[Path]) -> list[bytes] | Absent:
    contents = []
    for path in paths:
        try:
            contents.append(path.read_bytes())
        except FileNotFoundError:
            return Absent(str(path), "missing")
        except OSError as error:
            return Absent(str(path), f"cannot be read ({error.strerror})")
        if not _complete(contents[-1]):
            return Absent(str(path), "truncated")
    return contents


def _complete(content: bytes) -> bool:
    """Whether an image file ends as it should; decoders fill what is cut off with grey."""
    if content[:2] == b"\xff\xd8":
        return b"\xff\xd9" in content[-256:]
    if content[:4] == b"\x89PNG":
        return b"IEND" in content[-256:]
    return len(content) > 0


def _by(size: tuple[int, ...]) -> str:
    return f"{size[0]} x {size[1]}"
