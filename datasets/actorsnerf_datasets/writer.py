"""Prepared sequences written: the only code that writes the layout.

The same input gives a byte-identical file, and a file of the final name is always complete: it is
written as `<name>.part`, which is locked meanwhile, synchronised to disk, and renamed.
"""

import hashlib
import os
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.digests import digest_of_arrays, digest_of_strings
from actorsnerf_datasets.errors import LayoutError
from actorsnerf_datasets.file_lock import FileInUseError
from actorsnerf_datasets.header import Values, header_arrays, header_attributes
from actorsnerf_datasets.layout import DIGEST_ATTRIBUTE, ENTRIES
from actorsnerf_datasets.output_file import OutputFile
from actorsnerf_datasets.shapes import Form, misfits
from actorsnerf_datasets.types import Picture, Protocol, SequenceHeader

COMPRESSION_LEVEL = 4
"""Of zlib, for pictures and posed vertices; chosen by `benchmarks/results/storage.md`."""

_Array = NDArray[np.generic]


@dataclass(frozen=True)
class StoredPicture:
    """A picture ready to be written: its chunks are compressed already (`encode_picture`)."""

    camera_index: int
    frame_index: int
    offset: tuple[int, int]
    """x, y of the crop's top-left pixel in the full picture."""
    rgb_chunk: bytes
    alpha_chunk: bytes
    valid: bool = True
    """False: stored, but its fit or mask is not usable."""
    content: tuple[bytes, bytes] | None = None
    """What the two chunks hold, if it is at hand: spares the writer, which digests it, unpacking
    them."""


@dataclass(frozen=True)
class Conclusion:
    """What is known of a sequence once its pictures are written."""

    protocols: tuple[Protocol, ...]
    notes: tuple[str, ...]


def encode_picture(picture: Picture) -> tuple[bytes, bytes]:
    """The picture's colours and alpha as compressed chunks; runs well in worker processes."""
    return (
        zlib.compress(np.ascontiguousarray(picture.rgb).data, COMPRESSION_LEVEL),
        zlib.compress(np.ascontiguousarray(picture.alpha).data, COMPRESSION_LEVEL),
    )


def write_sequence(
    path: Path,
    header: SequenceHeader,
    crop_size: tuple[int, int],
    pictures: Iterable[StoredPicture],
    conclude: Callable[[], Conclusion] | None = None,
) -> None:
    """Leaves a complete prepared sequence at `path`, or nothing there.

    Args:
        path: the file; its folder must exist. A file of that name is replaced.
        header: all but the pictures.
        crop_size: width, height of every stored picture.
        pictures: consumed one at a time, stored in this order.
        conclude: called after the last picture; gives the protocols and notes to write in place of
            the header's.

    Raises:
        LayoutError: the header's arrays do not fit together, a picture has another size or comes
            twice, another process is writing the file, or the disk refuses (full, not writable).
    """
    arrays = header_arrays(header)
    _require_consistent(path, header, arrays)
    with _opened(path) as target:
        _write_pictures(target, header, crop_size, pictures)
        if conclude is not None:
            header = _with_conclusion(header, conclude())
        target.file.attrs.update(header_attributes(header))
        for name, values in arrays.items():
            _write_array(target.file, name, values)
        for protocol in header.protocols:
            _write_protocol(target.file, protocol)
    with suppress(OSError):  # some network file systems cannot synchronise a folder
        _synchronise(path.parent)


def _with_conclusion(header: SequenceHeader, found: Conclusion) -> SequenceHeader:
    provenance = replace(header.provenance, notes=found.notes)
    return replace(header, protocols=found.protocols, provenance=provenance)


@dataclass(frozen=True)
class _Target:
    """The file that is being written."""

    path: Path
    file: h5py.File
    output: OutputFile

    def require_written(self) -> None:
        """Raises if the disk refused something so far."""
        with _disk_errors(self.path):
            self.output.raise_failure()


@contextmanager
def _disk_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except FileInUseError as error:
        raise LayoutError(
            f"{path}: another preparation is writing it: wait for it or stop it, then try again"
        ) from error
    except OSError as error:
        raise LayoutError(
            f"{path}: could not be written ({error}): is the disk full or the folder read-only? "
            "Nothing was left under this name"
        ) from error


@contextmanager
def _opened(path: Path) -> Iterator[_Target]:
    """The file under its unfinished name, which becomes the final one, or is removed."""
    with _disk_errors(path):
        output = OutputFile(path.with_name(path.name + ".part"))
    with output:
        try:
            file = h5py.File(output, "w", libver="earliest")
            try:
                yield _Target(path, file, output)
            finally:
                file.close()
            with _disk_errors(path):
                output.synchronise()
                output.rename(path)
        except BaseException:
            output.remove()
            raise


def _require_consistent(path: Path, header: SequenceHeader, arrays: dict[str, Values]) -> None:
    if not header.cameras or not len(header.frames):
        raise LayoutError(f"{path}: a sequence needs at least one camera and one frame")
    forms = {
        name: Form(array.shape, str(array.dtype))
        if isinstance(array, np.ndarray)
        else Form((len(array),), "str")
        for name, array in arrays.items()
    }
    for misfit in misfits(forms):
        if not misfit.entry.startswith("pictures/"):
            raise LayoutError(f"{path}: {misfit.entry} {misfit.sentence}: nothing was written")
    names = [camera.name for camera in header.cameras]
    if len(set(names)) < len(names):
        raise LayoutError(f"{path}: two cameras have the same name among {names}")
    if np.any(np.diff(header.frames) <= 0):
        raise LayoutError(f"{path}: frame numbers are not strictly ascending")


def _write_pictures(
    target: _Target,
    header: SequenceHeader,
    crop_size: tuple[int, int],
    pictures: Iterable[StoredPicture],
) -> None:
    path, file = target.path, target.file
    width, height = crop_size
    forms = {"pictures/rgb": (height, width, 3), "pictures/alpha": (height, width)}
    datasets = {name: _growing(file, name, shape) for name, shape in forms.items()}
    digests = {name: hashlib.sha256() for name in forms}
    row = np.full((len(header.cameras), len(header.frames)), -1, np.int32)
    valid = np.zeros(row.shape, np.bool_)
    offsets: list[tuple[int, int]] = []
    for picture in pictures:
        place = (picture.camera_index, picture.frame_index)
        if not all(0 <= index < size for index, size in zip(place, row.shape, strict=True)):
            raise LayoutError(
                f"{path}: a picture of camera, frame {place}, but there are {row.shape}"
            )
        if row[place] >= 0:
            raise LayoutError(f"{path}: the picture of camera, frame {place} comes twice")
        row[place] = len(offsets)
        valid[place] = picture.valid
        offsets.append(picture.offset)
        chunks = (picture.rgb_chunk, picture.alpha_chunk)
        contents = picture.content or tuple(map(zlib.decompress, chunks))
        for name, chunk, content in zip(forms, chunks, contents, strict=True):
            _append_chunk(path, datasets[name], chunk, len(content))
            digests[name].update(content)
        target.require_written()
    for name, dataset in datasets.items():
        dataset.attrs[DIGEST_ATTRIBUTE] = digests[name].hexdigest()
    _write_array(file, "pictures/offset", np.array(offsets, np.int32).reshape(-1, 2))
    _write_array(file, "pictures/row", row)
    _write_array(file, "pictures/valid", valid)


def _growing(file: h5py.File, name: str, shape: tuple[int, ...]) -> h5py.Dataset:
    dataset = file.create_dataset(
        name,
        shape=(0, *shape),
        maxshape=(None, *shape),
        chunks=(1, *shape),
        dtype=np.uint8,
        compression="gzip",
        compression_opts=COMPRESSION_LEVEL,
    )
    _describe(dataset, name)
    return dataset


def _append_chunk(path: Path, dataset: h5py.Dataset, chunk: bytes, found: int) -> None:
    """Writes the chunk of a picture of `found` bytes."""
    count, *shape = dataset.shape
    expected = int(np.prod(shape))
    if found != expected:
        raise LayoutError(
            f"{path}: {dataset.name}: a picture of {found} bytes, expected "
            f"{expected} for {tuple(shape)}"
        )
    dataset.resize(count + 1, axis=0)
    dataset.id.write_direct_chunk((count, *(0 for _ in shape)), chunk)


def _write_protocol(file: h5py.File, protocol: Protocol) -> None:
    group = file.create_group(f"protocols/{protocol.name}")
    group.attrs["role"] = protocol.role
    group.attrs["training_camera"] = protocol.training_camera
    name = f"protocols/{protocol.name}"
    _write_array(file, f"{name}/evaluation_cameras", protocol.evaluation_cameras)
    _write_array(file, f"{name}/pretraining_frames", _numbers(protocol.pretraining_frames))
    _write_array(file, f"{name}/evaluation_frames", _numbers(protocol.evaluation_frames))
    for shots in protocol.shots:
        place = f"{name}/shots/{shots.name}/{shots.list_name}"
        _write_array(file, f"{place}/frames", _numbers(shots.frames))
        _write_array(file, f"{place}/support", _numbers(shots.support))


def _numbers(frames: Sequence[int]) -> _Array:
    return np.array(frames, np.int64)


def _write_array(file: h5py.File, name: str, array: Values) -> None:
    if isinstance(array, np.ndarray):
        large = name == "fits/posed_vertices"
        dataset = file.create_dataset(
            name,
            data=array,
            chunks=(1, *array.shape[1:]) if large else None,
            compression="gzip" if large else None,
            compression_opts=COMPRESSION_LEVEL if large else None,
            shuffle=large,
        )
        dataset.attrs[DIGEST_ATTRIBUTE] = digest_of_arrays([array])
    else:
        encoded = [line.encode() for line in array]
        length = max([1, *map(len, encoded)])
        kind = h5py.string_dtype("utf-8", length)
        dataset = file.create_dataset(name, data=np.array(encoded, kind), dtype=kind)
        dataset.attrs[DIGEST_ATTRIBUTE] = digest_of_strings(array)
    _describe(dataset, name)


_MEANINGS = {entry.path: entry for entry in ENTRIES}


def _describe(dataset: h5py.Dataset, name: str) -> None:
    if name in _MEANINGS:
        entry = _MEANINGS[name]
        dataset.attrs["axes"] = ", ".join(entry.axes)
        dataset.attrs["meaning"] = entry.meaning


def _synchronise(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
