"""Pickles read without running them: an allow-list of harmless names, all else refused.

A pickle is a program. The files of this field (SMPL models, ZJU-MoCap and AIST++ annotations) need
only numpy arrays, plain containers, and three classes of packages that we do not want to install:
chumpy's arrays and scipy's sparse matrices, both turned into numpy arrays here.
"""

import io
import math
import pickle
from collections import OrderedDict
from pathlib import Path
from typing import cast

import numpy as np
from numpy._core import multiarray

from actorsnerf_datasets.errors import UserError

_LARGEST_DENSE = 200_000_000
"""Entries of a sparse matrix that we are willing to fill in; SMPL's regressor has 165,360."""

_DAMAGED = (
    pickle.UnpicklingError,
    AttributeError,
    EOFError,
    ImportError,
    IndexError,
    KeyError,
    MemoryError,
    OverflowError,
    RecursionError,
    TypeError,
    ValueError,
)
"""What Python's unpickler and numpy's constructors raise on damaged input."""


class PickleError(UserError):
    """A pickle is damaged, or names something that is not on the allow-list."""


def load_pickle(path: Path) -> object:
    """The content of a pickle file: plain containers, numbers, strings and numpy arrays.

    chumpy and scipy.sparse objects come out as dense numpy arrays, and Python 2 strings as latin-1
    text. Nothing in the file is executed.

    Raises:
        PickleError: the file is missing or damaged, or names anything else (it is named).
    """
    return _unpickled(_content(path), path)


def load_npy(path: Path) -> object:
    """The content of a .npy file, also of one that holds pickled Python objects.

    A saved dictionary comes out as the dictionary, not as an array around it; an array of objects
    as an array whose elements are plain. A file that is a bare pickle is read as one.

    Raises:
        PickleError: the file is missing or damaged, or its pickle names something not allowed.
    """
    content = _content(path)
    if not content.startswith(b"\x93NUMPY"):
        return _unpickled(content, path)
    stream = io.BytesIO(content)
    try:
        version = np.lib.format.read_magic(stream)
        if version == (1, 0):
            _, _, dtype = np.lib.format.read_array_header_1_0(stream)
        else:
            _, _, dtype = np.lib.format.read_array_header_2_0(stream)
        if not dtype.hasobject:
            stream.seek(0)
            return np.lib.format.read_array(stream, allow_pickle=False)
    except _DAMAGED as error:
        raise PickleError(
            f"{path}: not a readable .npy file ({error}): is the download complete?"
        ) from error
    return _unpickled(stream.read(), path)


class _Immutable(type):
    """Refuses what a pickle could otherwise do to a class: set its attributes."""

    def __setattr__(cls, name: str, value: object) -> None:
        raise pickle.UnpicklingError(f"the pickle sets {cls.__name__}.{name}")


class _Stub(metaclass=_Immutable):
    """Stands for an object of a package that is not imported; keeps its state, runs nothing."""

    def __init__(self) -> None:
        self.state: dict[str, object] = {}

    def __setstate__(self, state: object) -> None:
        if not isinstance(state, dict):
            raise pickle.UnpicklingError(f"unexpected state of {type(self).__name__}")
        self.state = state


class _ChumpyArray(_Stub):
    """`chumpy.ch.Ch`: the array is under `x`."""


class _ChumpySelect(_Stub):
    """`chumpy.reordering.Select`: elements `idxs` of `a`, in `preferred_shape`."""


class _SparseColumns(_Stub):
    """`scipy.sparse.csc_matrix`."""


class _SparseRows(_Stub):
    """`scipy.sparse.csr_matrix`."""


class _Encode(metaclass=_Immutable):
    """`_codecs.encode`, the way protocol 2 writes bytes: latin-1 only."""

    def __new__(cls, text: str, encoding: str = "latin1") -> bytes:  # type: ignore[misc]
        """The bytes of a latin-1 text."""
        if encoding not in ("latin1", "latin-1"):
            raise pickle.UnpicklingError(f"the pickle asks for the codec {encoding!r}")
        return text.encode("latin1")


class _FromBuffer(metaclass=_Immutable):
    """`numpy.core.numeric._frombuffer`, the way protocol 5 writes arrays."""

    def __new__(  # type: ignore[misc]
        cls,
        buffer: bytes | bytearray,
        dtype: np.dtype[np.generic],
        shape: tuple[int, ...],
        order: str,
    ) -> np.ndarray:
        """The array in a buffer."""
        array = np.frombuffer(bytearray(buffer), dtype=dtype)  # writable
        return array.reshape(shape, order="F" if order == "F" else "C")


class _Reconstruct(metaclass=_Immutable):
    """`copyreg._reconstructor`, the way protocols 0 and 1 make an object of a Python class."""

    def __new__(cls, kind: type, base: type, state: object) -> _Stub:  # type: ignore[misc]
        """A stub without state."""
        if not (isinstance(kind, type) and issubclass(kind, _Stub) and base is object):
            raise pickle.UnpicklingError(f"the pickle makes an object of {kind!r}")
        return kind()


def _allowed() -> dict[str, object]:
    builtin: tuple[type, ...] = (
        *(bool, int, float, complex, str, bytes, bytearray),
        *(list, tuple, dict, set, frozenset, slice, range, object),
    )
    names: dict[str, object] = {f"builtins.{kind.__name__}": kind for kind in builtin}
    names["builtins.long"] = int
    names["builtins.unicode"] = str
    for package in ("numpy.core", "numpy._core"):
        names[f"{package}.multiarray._reconstruct"] = multiarray._reconstruct
        names[f"{package}.multiarray.scalar"] = multiarray.scalar
        names[f"{package}.numeric._frombuffer"] = _FromBuffer
    names |= {
        "numpy.ndarray": np.ndarray,
        "numpy.dtype": np.dtype,
        "collections.OrderedDict": OrderedDict,
        "_codecs.encode": _Encode,
        "copyreg._reconstructor": _Reconstruct,
        "chumpy.ch.Ch": _ChumpyArray,
        "chumpy.reordering.Select": _ChumpySelect,
    }
    for module in ("csc", "_csc"):
        names[f"scipy.sparse.{module}.csc_matrix"] = _SparseColumns
        names[f"scipy.sparse.{module}.csc_array"] = _SparseColumns
    for module in ("csr", "_csr"):
        names[f"scipy.sparse.{module}.csr_matrix"] = _SparseRows
        names[f"scipy.sparse.{module}.csr_array"] = _SparseRows
    return names


_ALLOWED = _allowed()
_PYTHON_2_MODULES = {"__builtin__": "builtins", "copy_reg": "copyreg"}


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, path: Path) -> None:
        super().__init__(stream, encoding="latin1")
        self._path = path

    def find_class(self, module: str, name: str) -> object:
        """The allowed object of this name."""
        full_name = f"{_PYTHON_2_MODULES.get(module, module)}.{name}"
        if full_name not in _ALLOWED:
            raise PickleError(
                f"{self._path}: refused, because its pickle names {full_name}, which no data file "
                "of this kind needs and which could run code: get the file from its original source"
            )
        return _ALLOWED[full_name]


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise PickleError(f"{path}: cannot be read ({error.strerror})") from error


def _unpickled(content: bytes, path: Path) -> object:
    try:
        value = _plain(_Unpickler(io.BytesIO(content), path).load())
    except PickleError:
        raise
    except _DAMAGED as error:
        raise PickleError(
            f"{path}: not a readable pickle ({error}): is the download complete?"
        ) from error
    return value


def _plain(value: object) -> object:
    """The value with every stub in it replaced by its array."""
    if isinstance(value, _Stub):
        return _stub_array(value)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if isinstance(value, tuple):
        return tuple(_plain(item) for item in value)
    if isinstance(value, np.ndarray) and value.dtype == object:
        if value.ndim == 0:
            return _plain(value[()])
        flat = np.empty(value.size, dtype=object)
        for index, item in enumerate(value.ravel()):
            flat[index] = _plain(item)
        return flat.reshape(value.shape)
    return value


def _stub_array(stub: _Stub) -> object:
    state = stub.state
    if isinstance(stub, _ChumpyArray):
        return _plain(state["x"])
    if isinstance(stub, _ChumpySelect):
        source = np.asarray(_plain(state["a"])).ravel()
        chosen = source[np.asarray(_plain(state["idxs"]))]
        return chosen.reshape(cast(tuple[int, ...], state["preferred_shape"]))
    if not isinstance(stub, _SparseColumns | _SparseRows):
        raise pickle.UnpicklingError(f"unexpected {type(stub).__name__}")
    return _dense(state, by_column=isinstance(stub, _SparseColumns))


def _dense(state: dict[str, object], by_column: bool) -> object:
    rows, columns = (int(size) for size in cast(tuple[int, int], state["_shape"]))
    if math.prod((rows, columns)) > _LARGEST_DENSE:
        raise pickle.UnpicklingError(f"a sparse matrix of {rows} x {columns}")
    data, indices, starts = (np.asarray(state[key]) for key in ("data", "indices", "indptr"))
    major = np.repeat(np.arange(columns if by_column else rows), np.diff(starts))
    dense = np.zeros((rows, columns), dtype=data.dtype)
    np.add.at(dense, (indices, major) if by_column else (major, indices), data)
    return dense
