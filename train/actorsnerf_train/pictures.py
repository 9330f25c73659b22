"""Pictures and videos on disk: PNG, mp4, and strips that set pictures side by side."""

import errno
import struct
import zlib
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.types import UInt8
from actorsnerf_train.checkpoint import write_whole

UInt16 = NDArray[np.uint16]

DEPTH_UNITS = 1000.0
"""Depth PNGs count millimetres; 0 = nothing there, 65535 = that far or farther."""
STRIP_GAP = 4
"""White pixels between the pictures of a strip."""
ERROR_GAIN = 4.0
"""An error picture is as bright as it can be at 1 / ERROR_GAIN of full contrast."""
_HEADER = 33
"""Bytes of a PNG before its second chunk: the signature and the size."""
_MARK = b"tEXtSoftware\0actorsnerf"
"""Kind and content of the second chunk of the pictures that are written here."""


def to_bytes(rgb: Float[Tensor, "height width 3"]) -> UInt8:
    """The picture (H, W, 3) with 256 levels; outside [0, 1] is clipped."""
    levels = (rgb.detach().cpu().clamp(0.0, 1.0) * 255.0).round()
    picture: UInt8 = levels.numpy().astype(np.uint8)
    return picture


def write_png(path: Path, picture: UInt8) -> None:
    """Write an RGB (H, W, 3) or grey (H, W) picture."""
    ordered = picture[..., ::-1] if picture.ndim == 3 else picture  # OpenCV keeps BGR
    _write_encoded(path, np.ascontiguousarray(ordered))


def write_depth(path: Path, depth: Float[Tensor, "height width"]) -> None:
    """Write depth in metres as a 16-bit grey PNG of millimetres."""
    counts = (depth.detach().cpu().double() * DEPTH_UNITS).round().clamp(0, 65535)
    _write_encoded(path, counts.numpy().astype(np.uint16))


def is_own(path: Path) -> bool:
    """Whether the file is a picture that was written here: it says so itself."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        start = stream.read(_HEADER + 4 + len(_MARK))  # 4: the chunk's length comes first
    return start[_HEADER + 4 :] == _MARK


def read_png(path: Path) -> UInt8:
    """The RGB picture (H, W, 3) of a file.

    Raises:
        UserError: no such file, or no picture.
    """
    if not path.is_file():
        raise UserError(f"{path}: no such picture.")
    encoded = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    picture = cv2.imdecode(encoded, cv2.IMREAD_COLOR) if len(encoded) else None
    if picture is None:
        raise UserError(f"{path}: cannot be read as a picture: damaged file?")
    rgb: UInt8 = np.ascontiguousarray(picture[..., ::-1]).astype(np.uint8)
    return rgb


def write_video(path: Path, pictures: Iterable[UInt8], fps: float) -> None:
    """Write RGB pictures of one size as mp4 (MPEG-4 part 2, which OpenCV always has).

    Odd widths and heights lose their last column or row, which the codec demands.

    Raises:
        UserError: no pictures, or the codec is not there.
        OSError: not all of it could be written.
    """
    part = path.with_name(f"{path.stem}.part{path.suffix}")  # the suffix chooses the container
    writer: cv2.VideoWriter | None = None
    count = 0
    try:
        for picture in pictures:
            even = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2, ::-1]
            writer = writer or _video_writer(part, fps, (even.shape[1], even.shape[0]))
            writer.write(np.ascontiguousarray(even))
            count += 1
        if writer is None:
            raise UserError(f"{path}: there are no pictures to make a video of.")
        writer.release()
        _require_pictures(part, count, path)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def error_picture(
    truth: Float[Tensor, "height width 3"], prediction: Float[Tensor, "height width 3"]
) -> UInt8:
    """How wrong each pixel is: dark = right, bright yellow = off by 1 / `ERROR_GAIN` or more."""
    error = (truth - prediction).detach().cpu().abs().mean(dim=2)
    levels = (error * ERROR_GAIN).clamp(0.0, 1.0).mul(255.0).round().numpy().astype(np.uint8)
    coloured = cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO)
    return np.ascontiguousarray(coloured[..., ::-1]).astype(np.uint8)


def strip(rows: Sequence[Sequence[UInt8]]) -> UInt8:
    """One picture of rows and columns; smaller pictures lie top left in their white cell."""
    width, height = strip_cell(rows)
    columns = max(len(row) for row in rows)
    down, across = height + STRIP_GAP, width + STRIP_GAP
    sheet = np.full(
        (len(rows) * down - STRIP_GAP, columns * across - STRIP_GAP, 3), 255, dtype=np.uint8
    )
    for i, row in enumerate(rows):
        for j, picture in enumerate(row):
            y, x = i * down, j * across
            sheet[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
    return sheet


def strip_cell(rows: Sequence[Sequence[UInt8]]) -> tuple[int, int]:
    """Width and height of a strip's cells: those of its widest and of its highest picture."""
    pictures = [picture for row in rows for picture in row]
    return max(one.shape[1] for one in pictures), max(one.shape[0] for one in pictures)


def _video_writer(path: Path, fps: float, size: tuple[int, int]) -> cv2.VideoWriter:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
    if not writer.isOpened():
        raise UserError(f"{path}: OpenCV cannot write mp4 here; use the PNG pictures (--no-video).")
    return writer


def _require_pictures(part: Path, count: int, path: Path) -> None:
    """Nothing, if a video holds so many pictures; OpenCV's writer does not tell of a full disk."""
    reader = cv2.VideoCapture(str(part))
    found = int(reader.get(cv2.CAP_PROP_FRAME_COUNT)) if reader.isOpened() else 0
    reader.release()
    if found != count:
        reason = f"only {found} of {count} pictures could be written; is the disk full?"
        raise OSError(errno.EIO, reason, str(path))


def _write_encoded(path: Path, picture: UInt8 | UInt16) -> None:
    done, encoded = cv2.imencode(".png", picture)
    if not done:
        raise UserError(f"{path}: OpenCV could not encode the picture.")
    content = encoded.tobytes()
    mark = struct.pack(">I", len(_MARK) - 4) + _MARK + struct.pack(">I", zlib.crc32(_MARK))
    write_whole(path, content[:_HEADER] + mark + content[_HEADER:])
