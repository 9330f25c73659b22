import dataclasses
import os
import signal
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from actorsnerf_datasets.digests import digest_of_dataset
from actorsnerf_datasets.errors import LayoutError
from actorsnerf_datasets.layout import ENTRIES, ROOT_ATTRIBUTES
from actorsnerf_datasets.types import Picture, SequenceHeader
from actorsnerf_datasets.writer import Conclusion, StoredPicture, encode_picture, write_sequence

SIZE = (48, 64)
Pictures = Callable[[], Iterator[StoredPicture]]


def test_a_picture_decodes_to_itself(picture_of: Callable[[int, int], Picture]) -> None:
    picture = picture_of(1, 2)
    rgb, alpha = encode_picture(picture)
    assert zlib.decompress(rgb) == picture.rgb.tobytes()
    assert zlib.decompress(alpha) == picture.alpha.tobytes()


def test_every_entry_has_the_layouts_dtype_axes_and_digest(sequence_path: Path) -> None:
    with h5py.File(sequence_path) as file:
        assert set(ROOT_ATTRIBUTES) == set(file.attrs)
        for entry in ENTRIES:
            dataset = file[entry.path]
            assert dataset.attrs["axes"] == ", ".join(entry.axes)
            assert dataset.attrs["sha256"] == digest_of_dataset(dataset), entry.path
            is_text = h5py.check_string_dtype(dataset.dtype) is not None
            assert (entry.dtype == "str") == is_text
            assert is_text or str(dataset.dtype) == entry.dtype
        assert file["pictures/rgb"].chunks == (1, 64, 48, 3)
        assert file["pictures/alpha"].chunks == (1, 64, 48)
        assert file["fits/posed_vertices"].chunks == (1, 240, 3)


def test_the_same_input_gives_the_same_bytes(
    header: SequenceHeader, stored_pictures: Pictures, tmp_path: Path
) -> None:
    one, other = tmp_path / "one.h5", tmp_path / "other.h5"
    write_sequence(one, header, SIZE, stored_pictures())
    time.sleep(1.1)  # a time stamp in the file would differ now
    write_sequence(other, header, SIZE, stored_pictures())
    assert one.read_bytes() == other.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.h5", "other.h5"]


def test_contents_at_hand_give_the_same_bytes(
    header: SequenceHeader, stored_pictures: Pictures, tmp_path: Path
) -> None:
    def with_content() -> Iterator[StoredPicture]:
        for stored in stored_pictures():
            chunks = (stored.rgb_chunk, stored.alpha_chunk)
            rgb, alpha = map(zlib.decompress, chunks)
            yield dataclasses.replace(stored, content=(rgb, alpha))

    one, other = tmp_path / "one.h5", tmp_path / "other.h5"
    write_sequence(one, header, SIZE, stored_pictures())
    write_sequence(other, header, SIZE, with_content())
    assert one.read_bytes() == other.read_bytes()


def test_protocols_and_notes_may_be_concluded_from_the_pictures(
    header: SequenceHeader, stored_pictures: Pictures, tmp_path: Path
) -> None:
    written: list[StoredPicture] = []

    def pictures() -> Iterator[StoredPicture]:
        for stored in stored_pictures():
            written.append(stored)
            yield stored

    one, other = tmp_path / "one.h5", tmp_path / "other.h5"
    conclusion = Conclusion(header.protocols[:1], ("35 pictures.",))
    before = dataclasses.replace(header, protocols=())
    write_sequence(
        one,
        before,
        SIZE,
        pictures(),
        lambda: dataclasses.replace(conclusion, notes=(f"{len(written)} pictures.",)),
    )
    provenance = dataclasses.replace(header.provenance, notes=conclusion.notes)
    after = dataclasses.replace(header, protocols=conclusion.protocols, provenance=provenance)
    write_sequence(other, after, SIZE, stored_pictures())
    assert one.read_bytes() == other.read_bytes()


def test_any_hdf5_reader_decodes_the_pictures(
    sequence_path: Path, picture_of: Callable[[int, int], Picture]
) -> None:
    with h5py.File(sequence_path) as file:
        row = file["pictures/row"][1, 4]
        np.testing.assert_array_equal(file["pictures/rgb"][row], picture_of(1, 4).rgb)
        assert file["pictures/rgb"].compression == "gzip"
        assert file["pictures/row"][2, 11] == -1
        assert not file["pictures/valid"][2, 11]


def test_an_unusable_picture_is_stored_but_not_valid(
    header: SequenceHeader, stored_pictures: Pictures, tmp_path: Path
) -> None:
    first = dataclasses.replace(next(stored_pictures()), valid=False)
    write_sequence(tmp_path / "a.h5", header, SIZE, [first])
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["pictures/row"][0, 0] == 0
        assert not file["pictures/valid"][:].any()


def test_a_sequence_without_pictures_keeps_its_crop_size(
    header: SequenceHeader, tmp_path: Path
) -> None:
    write_sequence(tmp_path / "a.h5", header, SIZE, [])
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["pictures/rgb"].shape == (0, 64, 48, 3)


def test_what_does_not_fit_together_is_refused(
    header: SequenceHeader, stored_pictures: Pictures, tmp_path: Path
) -> None:
    path = tmp_path / "a.h5"
    first = next(stored_pictures())
    fits = dataclasses.replace(header.fits, transl=header.fits.transl[:-1])
    camera = dataclasses.replace(header.cameras[1], name="c01")
    cases: list[tuple[SequenceHeader, list[StoredPicture], str]] = [
        (
            dataclasses.replace(header, fits=fits),
            [],
            r"fits/transl has shape \(11, 3\), but axis F",
        ),
        (dataclasses.replace(header, cameras=()), [], "at least one camera"),
        (dataclasses.replace(header, frames=header.frames[::-1]), [], "not strictly ascending"),
        (dataclasses.replace(header, cameras=(header.cameras[0], camera)), [], "the same name"),
        (header, [first, first], r"camera, frame \(0, 0\) comes twice"),
        (header, [dataclasses.replace(first, frame_index=12)], r"frame \(0, 12\), but there are"),
        (
            header,
            [dataclasses.replace(first, rgb_chunk=zlib.compress(b"abc"))],
            r"pictures/rgb: a picture of 3 bytes, expected 9216 for \(64, 48, 3\)",
        ),
    ]
    for bad, pictures, sentence in cases:
        with pytest.raises(LayoutError, match=sentence):
            write_sequence(path, bad, SIZE, pictures)
    assert list(tmp_path.iterdir()) == []


def test_an_error_among_the_pictures_is_passed_on_and_nothing_is_left(
    header: SequenceHeader, stored_pictures: Pictures, tmp_path: Path
) -> None:
    def pictures() -> Iterator[StoredPicture]:
        yield next(stored_pictures())
        raise RuntimeError("a worker died")

    path = tmp_path / "a.h5"
    path.write_bytes(b"the former file")
    with pytest.raises(RuntimeError, match="a worker died"):
        write_sequence(path, header, SIZE, pictures())
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.h5"]
    assert path.read_bytes() == b"the former file"


@pytest.mark.skipif(sys.platform == "win32", reason="needs flock")
def test_a_second_writer_is_refused_and_the_first_file_is_whole(
    header: SequenceHeader, stored_pictures: Pictures, tmp_path: Path
) -> None:
    path, alone = tmp_path / "a.h5", tmp_path / "alone.h5"

    def pictures() -> Iterator[StoredPicture]:
        for stored in stored_pictures():
            yield stored
            with pytest.raises(LayoutError, match=r"a.h5: another preparation is writing it: wait"):
                write_sequence(path, header, SIZE, stored_pictures())

    write_sequence(alone, header, SIZE, stored_pictures())
    write_sequence(path, header, SIZE, pictures())
    assert path.read_bytes() == alone.read_bytes()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a.h5", "alone.h5"]


def test_a_missing_folder_is_one_sentence(header: SequenceHeader, tmp_path: Path) -> None:
    with pytest.raises(LayoutError, match=r"no/a.h5: could not be written"):
        write_sequence(tmp_path / "no" / "a.h5", header, SIZE, [])


_WRITE_AGAIN = """
import resource, sys, time
from pathlib import Path
from actorsnerf_datasets.errors import LayoutError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.writer import StoredPicture, encode_picture, write_sequence

source, target, limit = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
read = SequenceFile(source)
def pictures():
    for frame in range(12):
        picture = read.picture(0, frame)
        yield StoredPicture(0, frame, picture.offset, *encode_picture(picture))
        if not limit and frame == 5:
            print("waiting", flush=True)
            time.sleep(60)
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    write_sequence(target, read.complete_header(), read.crop_size, pictures())
except LayoutError as error:
    print(error)
"""


@pytest.mark.parametrize("limit", [2_000, 60_000])
def test_a_full_disk_leaves_no_file(sequence_path: Path, tmp_path: Path, limit: int) -> None:
    """A file-size limit makes writes fail in the way a full disk does."""
    folder = tmp_path / "out"
    folder.mkdir()
    arguments = [sys.executable, "-c", _WRITE_AGAIN, str(sequence_path), str(folder / "a.h5")]
    done = subprocess.run(
        [*arguments, str(limit)], capture_output=True, text=True, timeout=300, check=False
    )
    assert "a.h5: could not be written" in done.stdout, done.stderr
    assert [path for path in folder.iterdir() if path.suffix != ".part"] == []


def test_a_killed_process_leaves_only_a_part(sequence_path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    arguments = [sys.executable, "-c", _WRITE_AGAIN, str(sequence_path), str(folder / "a.h5"), "0"]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "waiting\n"
        os.kill(process.pid, signal.SIGKILL)
    assert [path.name for path in folder.iterdir()] == ["a.h5.part"]
