from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.given_masks import find_given_masks
from actorsnerf_preprocess.source import Absent

SIZE = (64, 48)


def mask(value: int = 255) -> UInt8:
    picture = np.zeros((48, 64), np.uint8)
    picture[10:40, 20:50] = value
    return picture


def written(path: Path, picture: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), picture)


@pytest.mark.parametrize("name", ["000204.png", "00000204.png", "frame_204.png", "c01-204.png"])
def test_the_number_at_the_end_of_the_name_is_the_frame(tmp_path: Path, name: str) -> None:
    written(tmp_path / "c01" / name, mask())
    given = find_given_masks(tmp_path, ["seq_c01", "c01"], SIZE)
    assert given is not None
    (found, nothing) = given.read_each([204, 208])
    assert isinstance(found, np.ndarray) and np.array_equal(found, mask())
    assert nothing is None
    assert given.files(204) == (tmp_path / "c01" / name,) and given.files(208) == ()


def test_the_first_name_that_has_masks_counts(tmp_path: Path) -> None:
    (tmp_path / "seq_c01").mkdir()
    written(tmp_path / "seq" / "c01" / "1.png", mask())
    written(tmp_path / "c01" / "2.png", mask())
    given = find_given_masks(tmp_path, ["seq_c01", "seq/c01", "c01"], SIZE)
    assert given is not None and list(given.pictures) == [1]
    assert find_given_masks(tmp_path, ["seq_c02"], SIZE) is None
    assert find_given_masks(None, ["c01"], SIZE) is None


@pytest.mark.parametrize(
    "picture",
    [
        mask(),
        mask(1),
        np.dstack([mask()] * 3),
        np.dstack([np.full((48, 64), 99, np.uint8)] * 3 + [mask()]),
        mask().astype(np.uint16) * 257,
    ],
    ids=["grey", "zero and one", "colour", "alpha", "16 bit"],
)
def test_every_way_to_store_a_mask_reads_the_same(tmp_path: Path, picture: np.ndarray) -> None:
    written(tmp_path / "c01" / "5.png", picture)
    given = find_given_masks(tmp_path, ["c01"], SIZE)
    assert given is not None
    (found,) = given.read_each([5])
    assert isinstance(found, np.ndarray) and np.array_equal(found, mask())


def test_soft_masks_stay_soft(tmp_path: Path) -> None:
    written(tmp_path / "c01" / "5.png", mask(128))
    given = find_given_masks(tmp_path, ["c01"], SIZE)
    assert given is not None
    (found,) = given.read_each([5])
    assert isinstance(found, np.ndarray) and found.max() == 128


def test_a_mask_of_another_size_or_no_picture_is_absent_with_a_reason(tmp_path: Path) -> None:
    written(tmp_path / "c01" / "5.png", mask()[:24])
    (tmp_path / "c01" / "6.png").write_bytes(b"no picture")
    given = find_given_masks(tmp_path, ["c01"], SIZE)
    assert given is not None
    assert list(given.read_each([5, 6])) == [
        Absent(str(tmp_path / "c01" / "5.png"), "mask of 64 x 24 instead of 64 x 48"),
        Absent(str(tmp_path / "c01" / "6.png"), "not a readable picture"),
    ]


def test_an_alpha_video_gives_a_mask_per_frame(tmp_path: Path) -> None:
    path = tmp_path / "seq_c01_alpha2.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 60.0, SIZE)
    for frame in range(4):
        writer.write(np.dstack([np.roll(mask(), 3 * frame, axis=1)] * 3))
    writer.release()
    given = find_given_masks(tmp_path, ["seq_c01"], SIZE)
    assert given is not None and given.files(0) == (path,)
    found = list(given.read_each([0, 2, 9]))
    assert found[2] is None
    for frame, picture in zip((0, 2), found, strict=False):
        assert isinstance(picture, np.ndarray)
        assert np.array_equal(picture > 127, np.roll(mask(), 3 * frame, axis=1) > 127)
