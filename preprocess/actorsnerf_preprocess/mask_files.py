"""What the bytes of a mask file say: the data set's own masks are labels, a user's are shares."""

import cv2
import numpy as np

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.source import Absent

JPEG_MASK_THRESHOLD = 127
"""Masks stored as JPEG are 0 and 255 plus compression noise; in all others, not 0 is person."""
COLOURED = 16
"""Levels by which the channels of a grey picture differ at most, after compression."""
FAINTEST = 1 / 8
"""A person's mask has shares above this; labels (CIHP: 0 to 19) stay far below."""


def person_mask(content: bytes) -> UInt8 | None:
    """The mask in the bytes of an image file: (H, W), 255 on the person, 0 elsewhere.

    Labels, palettes and colours alike: what is not zero in any channel is the person. None if the
    bytes are no image.
    """
    mask = _decoded(content)
    if mask is None:
        return None
    if mask.ndim == 3:
        mask = mask[..., :3].max(axis=2)
    return _not_zero(mask, content)


def given_mask(content: bytes, where: str) -> UInt8 | Absent:
    """The mask in the bytes of a user's file: (H, W) the person's share, 0 to 255.

    The alpha channel counts if there is one that is not opaque, else the grey levels, of 8 or 16
    bits; 0 and 1 are scaled up. Colours hold no shares: there, not zero is the person.

    Args:
        content: of the image file.
        where: what an absent mask is called.
    """
    mask = _decoded(content)
    if mask is None:
        return Absent(where, "not a readable picture")
    if mask.dtype not in (np.uint8, np.uint16):
        return Absent(where, f"mask of {mask.dtype} numbers, expected levels of 8 or 16 bits")
    full = np.iinfo(mask.dtype).max
    if mask.ndim == 3:
        colours = mask[..., :3]
        if mask.shape[2] == 4 and mask[..., 3].min() < full:
            mask = mask[..., 3]
        elif int((colours.max(2) - colours.min(2)).max()) > COLOURED * (full // 255):
            return _not_zero(colours.max(2), content)
        else:
            mask = colours.max(2)
    top = int(mask.max())
    if top == 1:
        return np.where(mask > 0, np.uint8(255), np.uint8(0))
    if 0 < top < FAINTEST * full:
        return Absent(
            where,
            f"mask with levels 0 to {top} of {full}, expected the person's share (0 and 1, or "
            f"0 to {full}): are these labels of body parts?",
        )
    return np.asarray(mask // (full // 255), np.uint8)


def _decoded(content: bytes) -> np.ndarray | None:
    if not content:
        return None
    return cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)


def _not_zero(mask: np.ndarray, content: bytes) -> UInt8:
    threshold = JPEG_MASK_THRESHOLD if content[:2] == b"\xff\xd8" else 0
    return np.asarray(cv2.threshold(mask, threshold, 255, cv2.THRESH_BINARY)[1], np.uint8)
