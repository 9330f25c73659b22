import errno
import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from actorsnerf_datasets.output_file import OutputFile


class FullDisk:
    """A raw file on a disk with room for `room` bytes."""

    def __init__(self, file: Any, room: int) -> None:
        self._file = file
        self._room = room

    def write(self, content: memoryview) -> int:
        count = min(len(content), self._room - self._file.tell())
        if count <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return int(self._file.write(content[:count]))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def test_hdf5_writes_through_it_what_it_writes_alone(tmp_path: Path) -> None:
    numbers = np.arange(5000).reshape(50, 100)
    with OutputFile(tmp_path / "a.h5") as output:
        with h5py.File(output, "w", libver="earliest") as file:
            file.create_dataset("numbers", data=numbers, chunks=(1, 100), compression="gzip")
            assert (file["numbers"][7] == numbers[7]).all()
        output.synchronise()
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["numbers"][:], numbers)


@pytest.mark.parametrize("room", [0, 100, 3000])
def test_a_full_disk_is_said_when_asked_for_and_hdf5_closes(tmp_path: Path, room: int) -> None:
    output = OutputFile(tmp_path / "a.h5")
    output._file = FullDisk(output._file, room)  # type: ignore[assignment] # a stand-in
    with h5py.File(output, "w", libver="earliest") as file:
        file["numbers"] = np.arange(5000)
    with pytest.raises(OSError, match="No space left on device"):
        output.raise_failure()
    with pytest.raises(OSError, match="No space left on device"):
        output.synchronise()
    output.close()
    assert (tmp_path / "a.h5").stat().st_size <= room


def test_a_write_in_pieces_is_whole(tmp_path: Path) -> None:
    class Slow(FullDisk):
        def write(self, content: memoryview) -> int:
            return int(self._file.write(content[:3]))

    with OutputFile(tmp_path / "a") as output:
        output._file = Slow(output._file, 0)  # type: ignore[assignment] # a stand-in
        assert output.write(b"whole sentence") == 14
        output.raise_failure()
        assert (output.seek(0), output.read(14)) == (0, b"whole sentence")
        assert (output.seek(5), output.read(3), output.tell()) == (5, b" se", 8)


def test_what_was_dropped_reads_as_zeros(tmp_path: Path) -> None:
    with OutputFile(tmp_path / "a") as output:
        output.write(b"ab")
        output.seek(0)
        assert output.read(4) == b"ab\0\0"


def test_a_file_that_cannot_be_made(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        OutputFile(tmp_path / "gone" / "a")


def test_what_was_there_is_gone_and_the_name_is_final(tmp_path: Path) -> None:
    path = tmp_path / "a.part"
    path.write_bytes(b"of a killed run")
    with OutputFile(path) as output:
        output.write(b"whole")
        output.rename(tmp_path / "a")
        output.remove()
    assert [(entry.name, entry.read_bytes()) for entry in tmp_path.iterdir()] == [("a", b"whole")]
    with OutputFile(path) as output:
        output.remove()
    assert not path.exists()
