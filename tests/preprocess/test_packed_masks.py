import numpy as np
import pytest

from actorsnerf_preprocess.packed_masks import packed_mask, unpacked_mask


@pytest.mark.parametrize("size", [(8, 8), (13, 7), (160, 120)])
def test_a_mask_comes_back(size: tuple[int, int], rng: np.random.Generator) -> None:
    mask = (rng.random(size[::-1]) < 0.3).astype(np.uint8) * np.uint8(255)
    assert np.array_equal(unpacked_mask(packed_mask(mask), size), mask)


def test_a_silhouette_is_small() -> None:
    mask = np.zeros((1024, 1024), np.uint8)
    mask[200:900, 400:600] = 255
    assert 0 < len(packed_mask(mask)) < 4000


def test_soft_masks_and_none_are_not_packed(rng: np.random.Generator) -> None:
    assert packed_mask(None) == b""
    soft = np.zeros((16, 16), np.uint8)
    soft[3, 4] = 254
    assert packed_mask(soft) == b""
    assert packed_mask(rng.integers(0, 256, (16, 16), dtype=np.uint8)) == b""


def test_an_empty_mask_comes_back() -> None:
    mask = np.zeros((9, 5), np.uint8)
    assert np.array_equal(unpacked_mask(packed_mask(mask), (5, 9)), mask)


@pytest.mark.parametrize("pixel", [(0, 0), (8, 4), (0, 4), (3, 2)])
def test_a_single_pixel_comes_back(pixel: tuple[int, int]) -> None:
    mask = np.zeros((9, 5), np.uint8)
    mask[pixel] = 255
    assert np.array_equal(unpacked_mask(packed_mask(mask), (5, 9)), mask)
