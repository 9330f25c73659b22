import dataclasses
import multiprocessing
import pickle
import shutil
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest

from actorsnerf_datasets.cameras import camera_from_world, project
from actorsnerf_datasets.errors import LayoutError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import Picture, SequenceHeader


def test_pictures_come_back(sequence_path: Path, picture_of: Callable[[int, int], Picture]) -> None:
    with SequenceFile(sequence_path) as sequence:
        for place in ((0, 0), (1, 11), (2, 10)):
            found, expected = sequence.picture(*place), picture_of(*place)
            np.testing.assert_array_equal(found.rgb, expected.rgb)
            np.testing.assert_array_equal(found.alpha, expected.alpha)
            assert found.offset == expected.offset
        assert sequence.crop_size == (48, 64)
        assert sequence.valid.sum() == 35
        assert sequence.row.max() == 34


def test_cameras_fold_the_body_in(sequence_path: Path, header: SequenceHeader) -> None:
    sequence = SequenceFile(sequence_path)
    camera, matrix = header.cameras[1], sequence.camera_from_body(1, 3)
    assert matrix.dtype == np.float64
    joints = header.fits.posed_joints[3]
    world = (
        joints @ header.fits.world_from_body[3, :3, :3].T + header.fits.world_from_body[3, :3, 3]
    )
    expected = project(world, camera.K, camera_from_world(camera.R, camera.T)).pixels
    found = project(joints, sequence.crop_K(1, 3), matrix).pixels
    np.testing.assert_allclose(found + sequence.picture(1, 3).offset, expected, atol=1e-9)


def test_the_whole_picture_is_rebuilt(
    sequence_path: Path, picture_of: Callable[[int, int], Picture]
) -> None:
    sequence, picture = SequenceFile(sequence_path), picture_of(0, 0)
    full = sequence.full_picture(0, 0, (1.0, 0.5, 0.0))
    assert full.shape == (80, 80, 3)
    (x, y), (width, height) = picture.offset, sequence.crop_size
    person = np.argwhere(picture.alpha == 255)[0]
    np.testing.assert_allclose(
        full[y + person[0], x + person[1]], picture.rgb[*person] / 255, atol=1e-6
    )
    inside = np.zeros((80, 80), bool)
    inside[max(y, 0) : y + height, max(x, 0) : x + width] = True
    assert (full[~inside] == np.array([1.0, 0.5, 0.0], np.float32)).all()
    assert sequence.full_alpha(0, 0).sum() == pytest.approx((picture.alpha / 255).sum())


def test_a_crop_that_hangs_over_the_edge_is_cut(sequence_path: Path) -> None:
    with h5py.File(sequence_path, "r+") as file:
        file["pictures/offset"][0] = [-10, 60]
    sequence = SequenceFile(sequence_path)
    alpha, crop = sequence.full_alpha(0, 0), sequence.picture(0, 0).alpha
    np.testing.assert_allclose(alpha[60:, :38], crop[:20, 10:] / 255, atol=1e-7)
    assert alpha[:60].sum() == alpha[:, 38:].sum() == 0


def test_names_and_numbers_are_found_or_named(sequence_path: Path) -> None:
    sequence = SequenceFile(sequence_path)
    assert (sequence.camera_index("c02"), sequence.frame_index(111)) == (1, 11)
    with pytest.raises(LayoutError, match="has no camera 'B1'; it has c01, c02, c03"):
        sequence.camera_index("B1")
    for number in (99, 112):
        with pytest.raises(LayoutError, match=f"has no frame {number}; it has 12 from 100 to 111"):
            sequence.frame_index(number)
    with pytest.raises(
        LayoutError, match=r"no picture of camera c03, frame 111 is stored; its report says why"
    ):
        sequence.picture(2, 11)


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_one_instance_serves_other_processes(sequence_path: Path, method: str) -> None:
    sequence = SequenceFile(sequence_path)
    expected = sequence.picture(0, 1)
    context = multiprocessing.get_context(method)
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        found = pool.submit(SequenceFile.picture, sequence, 0, 1).result(timeout=300)
    np.testing.assert_array_equal(found.rgb, expected.rgb)
    np.testing.assert_array_equal(sequence.picture(0, 1).rgb, expected.rgb)


def test_a_fork_opens_its_own_handle(sequence_path: Path) -> None:
    sequence = SequenceFile(sequence_path)
    handle = sequence._file()
    assert sequence._file() is handle
    sequence._process += 1  # what a forked child sees
    assert sequence._file() is not handle
    assert pickle.loads(pickle.dumps(sequence))._handle is None
    sequence.close()
    assert sequence.picture(0, 0).rgb.shape == (64, 48, 3)


def test_the_digest_follows_the_content(sequence_path: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.h5"
    shutil.copy(sequence_path, copy)
    assert SequenceFile(copy).digest == SequenceFile(sequence_path).digest
    with h5py.File(copy, "r+") as file:
        file["fits/transl"].attrs["sha256"] = "0" * 64
    assert SequenceFile(copy).digest != SequenceFile(sequence_path).digest


def test_what_is_no_sequence_of_ours_is_refused(sequence_path: Path, tmp_path: Path) -> None:
    with pytest.raises(LayoutError, match=r"no.h5: does not exist"):
        _ = SequenceFile(tmp_path / "no.h5").header
    text = tmp_path / "text.h5"
    text.write_text("hello")
    with pytest.raises(LayoutError, match=r"text.h5: cannot be opened as HDF5"):
        _ = SequenceFile(text).header
    with h5py.File(sequence_path, "r+") as file:
        file.attrs["layout_version"] = "2.0"
    with pytest.raises(
        LayoutError, match=r"has layout version 2.0, and this release reads 1.0: in"
    ):
        _ = SequenceFile(sequence_path).header
    with h5py.File(sequence_path, "r+") as file:
        file.attrs["format"] = "other"
    with pytest.raises(LayoutError, match="its format is 'other', expected 'actorsnerf-sequence'"):
        _ = SequenceFile(sequence_path).header


def test_a_newer_minor_version_is_read(sequence_path: Path, header: SequenceHeader) -> None:
    with h5py.File(sequence_path, "r+") as file:
        file.attrs["layout_version"] = "1.7"
        file["fits/expression"] = np.zeros(3)
        file["cameras/exposure"] = np.zeros(3)
    assert SequenceFile(sequence_path).header.actor == header.actor


def test_damaged_pictures_are_one_sentence(sequence_path: Path) -> None:
    with h5py.File(sequence_path, "r+") as file:
        file["pictures/rgb"].id.write_direct_chunk((0, 0, 0, 0), b"no zlib stream")
    with pytest.raises(
        LayoutError, match=r"pictures/rgb, row 0 cannot be decoded .* actorsnerf_datasets check"
    ):
        SequenceFile(sequence_path).picture(0, 0)


def test_the_header_is_kept(sequence_path: Path) -> None:
    sequence = SequenceFile(sequence_path)
    assert sequence.header is sequence.header
    assert dataclasses.is_dataclass(sequence.header)


def test_posed_vertices_stay_in_the_file(sequence_path: Path, header: SequenceHeader) -> None:
    with SequenceFile(sequence_path) as sequence:
        assert sequence.header.fits.posed_vertices.shape == (0, 240, 3)
        for frame in (0, 7):
            found = sequence.posed_vertices(frame)
            assert found.dtype == np.float32
            np.testing.assert_array_equal(found, header.fits.posed_vertices[frame])
        complete = sequence.complete_header()
    np.testing.assert_array_equal(complete.fits.posed_vertices, header.fits.posed_vertices)
    np.testing.assert_array_equal(complete.fits.transl, header.fits.transl)


def test_damaged_vertices_are_one_sentence(sequence_path: Path) -> None:
    with h5py.File(sequence_path, "r+") as file:
        file["fits/posed_vertices"].id.write_direct_chunk((3, 0, 0), b"no zlib stream")
    sequence = SequenceFile(sequence_path)
    assert sequence.posed_vertices(2).shape == (240, 3)
    with pytest.raises(LayoutError, match=r"fits/posed_vertices, row 3 cannot be decoded"):
        sequence.posed_vertices(3)
