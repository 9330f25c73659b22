"""Masks of zeros and 255s in a few kilobytes, to be kept from the first pass for the second."""

import zlib

import cv2
import numpy as np

from actorsnerf_datasets.types import UInt8

_LEVEL = 1
"""Of zlib: a mask of 1024 x 1024 takes about 3 kB, and half a millisecond."""


def packed_mask(mask: UInt8 | None) -> bytes:
    """The mask (H, W) as compressed bits; empty if there is none, or it has other levels.

    >>> packed_mask(np.full((4, 4), 90, np.uint8))
    b''
    """
    if mask is None or 255 * cv2.countNonZero(mask) != int(cv2.sumElems(mask)[0]):
        return b""
    return zlib.compress(np.packbits(mask).tobytes(), _LEVEL)


def unpacked_mask(packed: bytes, size: tuple[int, int]) -> UInt8:
    """The mask again.

    Args:
        packed: of `packed_mask`, not empty.
        size: width, height.
    """
    width, height = size
    bits = np.frombuffer(zlib.decompress(packed), np.uint8)
    mask = np.unpackbits(bits, count=width * height).reshape(height, width)
    return np.multiply(mask, np.uint8(255), dtype=np.uint8)
