"""Prepared sequences read: lazily, and safely in forked and spawned worker processes."""

import hashlib
import os
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.cameras import camera_from_world, cropped_intrinsics
from actorsnerf_datasets.errors import LayoutError
from actorsnerf_datasets.header import read_header
from actorsnerf_datasets.layout import DIGEST_ATTRIBUTE, FORMAT, LAYOUT_MAJOR, LAYOUT_VERSION
from actorsnerf_datasets.shell import quoted
from actorsnerf_datasets.types import Float32, Float64, Picture, SequenceHeader, UInt8


class SequenceFile:
    """One prepared sequence. Nothing is opened before it is needed.

    Each process opens its own handle, so an instance may be pickled, or inherited by a fork.
    Cameras and frames are positions in `header.cameras` and `header.frames`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._handle: h5py.File | None = None
        self._process = 0

    def __getstate__(self) -> dict[str, object]:
        return {"path": self.path, "_handle": None, "_process": 0}

    def __enter__(self) -> "SequenceFile":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes this process's handle; the next access opens it again."""
        if self._handle is not None and self._process == os.getpid():
            self._handle.close()
        self._handle = None

    @cached_property
    def header(self) -> SequenceHeader:
        """All of the sequence but its pictures and posed vertices, which stay in the file.

        Raises:
            LayoutError: the file is missing, no prepared sequence, or of a newer layout.
        """
        return read_header(self._file(), self.path, posed_vertices=False)

    def complete_header(self) -> SequenceHeader:
        """The header with the posed vertices of all frames, read anew: as the writer takes it.

        Raises:
            LayoutError: as `header`.
        """
        return read_header(self._file(), self.path)

    def posed_vertices(self, frame: int) -> Float32:
        """The body's vertices (V, 3) in the frame at this position, body frame, metres.

        Raises:
            LayoutError: the data is damaged.
        """
        return np.asarray(self._decoded("fits/posed_vertices", frame), np.float32)

    @cached_property
    def crop_size(self) -> tuple[int, int]:
        """Width and height of every stored picture."""
        _, height, width = self._file()["pictures/alpha"].shape
        return int(width), int(height)

    @cached_property
    def row(self) -> NDArray[np.int32]:
        """(cameras, frames) which stored picture; -1 where none is."""
        return np.asarray(self._file()["pictures/row"][:])

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """(cameras, frames) stored, with a usable fit and mask."""
        return np.asarray(self._file()["pictures/valid"][:])

    @cached_property
    def offsets(self) -> NDArray[np.int32]:
        """(pictures, 2) x, y of each crop's top-left pixel in its full picture."""
        return np.asarray(self._file()["pictures/offset"][:])

    @cached_property
    def digest(self) -> str:
        """Hex SHA-256 over the names and stored digests of all datasets: the file's identity."""
        lines: list[str] = []

        def collect(name: str, node: h5py.Dataset | h5py.Group) -> None:
            if isinstance(node, h5py.Dataset):
                lines.append(f"{name} {node.attrs.get(DIGEST_ATTRIBUTE, '')}\n")

        self._file().visititems(collect)
        return hashlib.sha256("".join(sorted(lines)).encode()).hexdigest()

    def camera_index(self, name: str) -> int:
        """Position of the camera of this name.

        Raises:
            LayoutError: there is none.
        """
        names = [camera.name for camera in self.header.cameras]
        if name not in names:
            raise LayoutError(f"{self.path}: has no camera {name!r}; it has {', '.join(names)}")
        return names.index(name)

    def frame_index(self, number: int) -> int:
        """Position of the frame with this number of the source.

        Raises:
            LayoutError: there is none.
        """
        frames = self.header.frames
        index = int(np.searchsorted(frames, number))
        if index == len(frames) or frames[index] != number:
            raise LayoutError(
                f"{self.path}: has no frame {number}; it has {len(frames)} from {frames[0]} to "
                f"{frames[-1]}"
            )
        return index

    def picture(self, camera: int, frame: int) -> Picture:
        """The stored crop of this camera and frame.

        Raises:
            LayoutError: it is not stored, or its data is damaged.
        """
        row = self._row(camera, frame)
        rgb, alpha = (self._decoded(f"pictures/{name}", row) for name in ("rgb", "alpha"))
        x, y = self.offsets[row].tolist()
        return Picture(rgb=rgb, alpha=alpha, offset=(x, y))

    def crop_K(self, camera: int, frame: int) -> Float64:
        """Intrinsics (3, 3) of this crop, pixels.

        Raises:
            LayoutError: the picture is not stored.
        """
        x, y = self.offsets[self._row(camera, frame)].tolist()
        return cropped_intrinsics(self.header.cameras[camera].K, (x, y))

    def camera_from_body(self, camera: int, frame: int) -> Float64:
        """The rigid transform (4, 4) from this frame's body to this camera, folded in float64."""
        found = self.header.cameras[camera]
        world_from_body = self.header.fits.world_from_body[frame]
        folded: Float64 = camera_from_world(found.R, found.T) @ world_from_body
        return folded

    def full_picture(
        self, camera: int, frame: int, background: tuple[float, float, float]
    ) -> Float32:
        """The whole picture (height, width, 3) in [0, 1]: the person on a plain background.

        Args:
            camera: position of the camera.
            frame: position of the frame.
            background: red, green, blue in [0, 1].

        Raises:
            LayoutError: the picture is not stored.
        """
        alpha = self.full_alpha(camera, frame)[..., None]
        picture = self.picture(camera, frame)
        straight = self._pasted(camera, _unit(picture.rgb), picture.offset)
        return straight * alpha + np.array(background, np.float32) * (1 - alpha)

    def full_alpha(self, camera: int, frame: int) -> Float32:
        """The person's share (height, width) of each pixel of the whole picture, in [0, 1].

        Raises:
            LayoutError: the picture is not stored.
        """
        picture = self.picture(camera, frame)
        return self._pasted(camera, _unit(picture.alpha), picture.offset)

    def _pasted(self, camera: int, crop: Float32, offset: tuple[int, int]) -> Float32:
        """Zeros of the full size with the crop in its place; what hangs over is cut off."""
        width, height = self.header.cameras[camera].size
        full = np.zeros((height, width, *crop.shape[2:]), np.float32)
        x, y = offset
        left, top = max(x, 0), max(y, 0)
        right, bottom = min(x + crop.shape[1], width), min(y + crop.shape[0], height)
        if left < right and top < bottom:
            full[top:bottom, left:right] = crop[top - y : bottom - y, left - x : right - x]
        return full

    def _row(self, camera: int, frame: int) -> int:
        row = int(self.row[camera, frame])
        if row < 0:
            raise LayoutError(
                f"{self.path}: no picture of camera {self.header.cameras[camera].name}, frame "
                f"{self.header.frames[frame]} is stored; its report says why (to have all, prepare "
                "with --all-pairs)"
            )
        return row

    def _decoded(self, name: str, row: int) -> NDArray[Any]:
        try:
            return np.asarray(self._file()[name][row])
        except (OSError, RuntimeError) as error:
            raise LayoutError(
                f"{self.path}: {name}, row {row} cannot be decoded ({error}): is the file damaged? "
                f"Run: python -m actorsnerf_datasets check {quoted(self.path)}"
            ) from error

    def _file(self) -> h5py.File:
        if self._handle is None or self._process != os.getpid():
            self._handle = None  # lets an inherited handle go, so that the file is opened anew
            self._handle = open_sequence(self.path)
            self._process = os.getpid()
        return self._handle


def open_sequence(path: Path) -> h5py.File:
    """The open HDF5 file, once it is known to be a prepared sequence that we can read.

    Raises:
        LayoutError: it is missing, no HDF5 file, another kind of file, or of a newer layout.
    """
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        reason = "does not exist" if not path.exists() else f"cannot be opened as HDF5 ({error})"
        raise LayoutError(f"{path}: {reason}; prepared sequences end in .h5") from error
    found = file.attrs.get("format")
    if found != FORMAT:
        file.close()
        raise LayoutError(
            f"{path}: its format is {found!r}, expected {FORMAT!r}: was it made by another program?"
        )
    version = str(file.attrs.get("layout_version"))
    if version.split(".")[0] != str(LAYOUT_MAJOR):
        file.close()
        raise LayoutError(
            f"{path}: has layout version {version}, and this release reads {LAYOUT_VERSION}: "
            "install the release of actorsnerf that wrote it, or prepare it again"
        )
    return file


def _unit(values: UInt8) -> Float32:
    unit: Float32 = values.astype(np.float32) / np.float32(255)
    return unit
