"""Masks of zeros and 255s in a few kilobytes, to be kept from the first pass for the second."""

import struct
import zlib

import cv2
import numpy as np

from actorsnerf_datasets.types import UInt8

_LEVEL = 1
"""Of zlib: a mask of 1024 x 1024 takes about 3 kB, and a quarter of a millisecond."""
_BOX = struct.Struct("<4i")
"""Left, top, width, height of what is not zero; the bits that follow are of this box only."""


def packed_mask(mask: UInt8 | None) -> bytes:
    """The mask (H, W) as compressed bits; empty if there is none, or it has other levels.

    >>> packed_mask(np.full((4, 4), 90, np.uint8))
    b''
    """
    if mask is None or 255 * cv2.countNonZero(mask) != int(cv2.sumElems(mask)[0]):
        return b""
    x, y, width, height = cv2.boundingRect(mask)
    bits = np.packbits(mask[y : y + height, x : x + width])
    return _BOX.pack(x, y, width, height) + zlib.compress(bits.tobytes(), _LEVEL)


def unpacked_mask(packed: bytes, size: tuple[int, int]) -> UInt8:
    """The mask again.

    Args:
        packed: of `packed_mask`, not empty.
        size: width, height.
    """
    x, y, width, height = _BOX.unpack_from(packed)
    bits = np.frombuffer(zlib.decompress(packed[_BOX.size :]), np.uint8)
    person = np.unpackbits(bits, count=width * height).reshape(height, width)
    mask = np.zeros(size[::-1], np.uint8)
    np.multiply(person, np.uint8(255), out=mask[y : y + height, x : x + width])
    return mask
