"""A picture of a prepared sequence: frames by cameras, with skeleton and mask outline.

Needs OpenCV, which comes with the `preprocess` and `train` extras.
"""

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np

from actorsnerf_datasets.cameras import project
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.skeleton import BONES
from actorsnerf_datasets.types import UInt8

BACKGROUND = 96
_OUTLINE = (0, 255, 0)
_BONE = (255, 128, 0)
_TEXT = (255, 255, 255)
LABEL_HEIGHT = 14
"""Pixels of the strip above each tile."""
LABEL_SCALE = 0.7
"""Of OpenCV's plain font: capitals of 7 pixels."""


def write_contact_sheet(
    sequence: SequenceFile, path: Path, frames: int = 6, cameras: int = 6
) -> None:
    """Leaves a PNG: one row per frame, one column per camera, both spread over the sequence.

    Args:
        sequence: the prepared file.
        path: ends in .png.
        frames: at most this many rows.
        cameras: at most this many columns.

    Raises:
        UserError: OpenCV is not installed, or the picture cannot be written.
    """
    sheet = contact_sheet(sequence, frames, cameras)
    cv2 = _opencv()
    done, encoded = cv2.imencode(".png", sheet[..., ::-1])
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(encoded.tobytes() if done else b"")
        part.replace(path)
    except OSError as error:
        raise UserError(
            f"{path}: the contact sheet cannot be written ({error.strerror})"
        ) from error


def contact_sheet(sequence: SequenceFile, frames: int, cameras: int) -> UInt8:
    """The contact sheet as an RGB picture (height, width, 3).

    Raises:
        UserError: OpenCV is not installed.
    """
    usable = np.flatnonzero(sequence.valid.any(axis=0))
    rows = _spread(usable.tolist() or [0], frames)
    columns = _spread(list(range(len(sequence.header.cameras))), cameras)
    times = _enlarged(sequence, [(camera, frame) for camera in columns for frame in rows])
    return np.concatenate(
        [
            np.concatenate([_tile(sequence, (camera, frame), times) for camera in columns], axis=1)
            for frame in rows
        ]
    )


def _enlarged(sequence: SequenceFile, places: list[tuple[int, int]]) -> int:
    """How many times as large the pictures are drawn, so that the labels above them fit."""
    cv2 = _opencv()
    width = sequence.crop_size[0]
    times = 1
    for place in places:
        label = _label(sequence, place)
        needed = cv2.getTextSize(label, cv2.FONT_HERSHEY_PLAIN, LABEL_SCALE, 1)[0][0] + 4
        times = max(times, -(-int(needed) // width))
    return times


def _label(sequence: SequenceFile, place: tuple[int, int]) -> str:
    camera, frame = place
    return f"{sequence.header.cameras[camera].name} {sequence.header.frames[frame]}"


def _spread(items: list[int], count: int) -> list[int]:
    if len(items) <= count:
        return items
    return [items[round(index * (len(items) - 1) / max(count - 1, 1))] for index in range(count)]


def _tile(sequence: SequenceFile, place: tuple[int, int], times: int) -> UInt8:
    cv2 = _opencv()
    camera, frame = place
    label = _label(sequence, place)
    width, height = (side * times for side in sequence.crop_size)
    tile = np.full((LABEL_HEIGHT + height, width, 3), 32, np.uint8)
    cv2.putText(tile, label, (2, LABEL_HEIGHT - 4), cv2.FONT_HERSHEY_PLAIN, LABEL_SCALE, _TEXT)
    if sequence.row[camera, frame] >= 0:
        picture = _drawn(sequence, camera, frame)
        tile[LABEL_HEIGHT:] = picture.repeat(times, axis=0).repeat(times, axis=1)
    return tile


def _drawn(sequence: SequenceFile, camera: int, frame: int) -> UInt8:
    """The crop on grey, with the mask's outline and the projected bones."""
    cv2 = _opencv()
    picture = sequence.picture(camera, frame)
    alpha = picture.alpha[..., None].astype(np.float64) / 255
    blended = picture.rgb * alpha + BACKGROUND * (1 - alpha)
    image = np.ascontiguousarray(blended.round().astype(np.uint8))
    person = (picture.alpha > 127).astype(np.uint8)
    outlines, _ = cv2.findContours(person, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(image, outlines, -1, _OUTLINE, 1)
    joints = project(
        sequence.header.fits.posed_joints[frame],
        sequence.crop_K(camera, frame),
        sequence.camera_from_body(camera, frame),
    )
    for parent, joint in BONES:
        if joints.in_front[parent] and joints.in_front[joint]:
            ends = joints.pixels[[parent, joint]].clip(-1e4, 1e4).round().astype(int).tolist()
            cv2.line(image, tuple(ends[0]), tuple(ends[1]), _BONE, 1, cv2.LINE_AA)
    return image


def _opencv() -> ModuleType:
    try:
        return importlib.import_module("cv2")
    except ImportError as error:
        raise UserError(
            "a contact sheet needs OpenCV, which is not installed: pip install "
            "'actorsnerf[preprocess]'"
        ) from error
