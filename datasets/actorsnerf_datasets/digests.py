"""SHA-256 of a dataset's content, as stored beside it."""

import hashlib
from collections.abc import Iterable, Sequence

import h5py
import numpy as np
from numpy.typing import NDArray


def digest_of_arrays(parts: Iterable[NDArray[np.generic]]) -> str:
    """Hex SHA-256 of the bytes of consecutive parts of an array, C order, little endian.

    >>> digest_of_arrays([np.zeros(1, np.uint8)])[:8]
    '6e340b9c'
    """
    sha = hashlib.sha256()
    for part in parts:
        little = part.astype(part.dtype.newbyteorder("<"), copy=False)
        sha.update(np.ascontiguousarray(little).view(np.uint8).data)
    return sha.hexdigest()


def digest_of_strings(strings: Sequence[str]) -> str:
    r"""Hex SHA-256 of the strings as UTF-8 lines, each ended by `\n`."""
    return hashlib.sha256("".join(f"{line}\n" for line in strings).encode()).hexdigest()


def digest_of_dataset(dataset: h5py.Dataset) -> str:
    """Hex SHA-256 of a dataset in a file, one chunk of rows in memory at a time."""
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return digest_of_strings(list(dataset.asstr()[:]))
    rows = 1 if dataset.chunks is None else dataset.chunks[0]
    if dataset.chunks is None or dataset.ndim == 0:
        return digest_of_arrays([np.asarray(dataset[()])])
    starts = range(0, dataset.shape[0], rows)
    return digest_of_arrays(dataset[start : start + rows] for start in starts)
