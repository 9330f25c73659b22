import cv2
import numpy as np
import pytest

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.mask_files import given_mask, person_mask
from actorsnerf_preprocess.source import Absent

LEVELS = np.array([[0, 1, 3, 40, 128, 250, 255]], np.uint8)
GREY = np.full((*LEVELS.shape, 3), 99, np.uint8)


def png(image: UInt8) -> bytes:
    return bytes(cv2.imencode(".png", image)[1].tobytes())


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        (np.array([[0, 1, 19]], np.uint8), [0, 255, 255]),
        (np.array([[[0, 0, 0], [0, 0, 128], [85, 51, 0]]], np.uint8), [0, 255, 255]),
        (np.array([[[0, 0, 0, 255], [9, 0, 0, 255]]], np.uint8), [0, 255]),
        (np.array([[0, 300, 65535]], np.uint16), [0, 255, 255]),
    ],
)
def test_labels_palettes_and_colours_are_person_where_not_zero(
    mask: UInt8, expected: list[int]
) -> None:
    found = person_mask(png(mask))
    assert found is not None
    assert found[0].tolist() == expected


def test_jpeg_noise_is_not_the_person() -> None:
    mask = np.zeros((64, 64), np.uint8)
    mask[16:48, 16:48] = 255
    content = cv2.imencode(".jpg", mask, [cv2.IMWRITE_JPEG_QUALITY, 60])[1].tobytes()
    found = person_mask(bytes(content))
    assert found is not None
    assert np.array_equal(found, mask)


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        (LEVELS, LEVELS[0].tolist()),
        (LEVELS.astype(np.uint16) * 257, LEVELS[0].tolist()),
        (np.dstack([LEVELS] * 3), LEVELS[0].tolist()),
        (np.dstack([GREY, LEVELS]), LEVELS[0].tolist()),
        (np.dstack([LEVELS, LEVELS, LEVELS, np.full_like(LEVELS, 255)]), LEVELS[0].tolist()),
        (np.array([[0, 1]], np.uint8), [0, 255]),
        (np.array([[0, 1]], np.uint16), [0, 255]),
        (np.dstack([GREY[:, :2], np.array([[0, 1]], np.uint8)]), [0, 255]),
        (np.zeros((1, 3), np.uint8), [0, 0, 0]),
        (np.array([[[0, 0, 0], [0, 0, 128], [85, 51, 0]]], np.uint8), [0, 255, 255]),
    ],
    ids=[
        *("grey", "16 bit", "three channels", "alpha", "opaque alpha"),
        *("0 and 1", "0 and 1 in 16 bit", "0 and 1 as alpha", "empty", "colours"),
    ],
)
def test_masks_of_the_user_are_shares(mask: UInt8, expected: list[int]) -> None:
    found = given_mask(png(mask), "mine.png")
    assert not isinstance(found, Absent)
    assert found[0].tolist() == expected


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "not a readable picture"),
        (b"no picture", "not a readable picture"),
        (
            png(np.array([[0, 7, 19]], np.uint8)),
            "mask with levels 0 to 19 of 255, expected the person's share (0 and 1, or 0 to 255): "
            "are these labels of body parts?",
        ),
        (
            bytes(cv2.imencode(".tiff", np.ones((2, 2), np.float32))[1].tobytes()),
            "mask of float32 numbers, expected levels of 8 or 16 bits",
        ),
    ],
    ids=["empty", "text", "labels", "numbers"],
)
def test_what_is_no_mask_of_the_user_is_refused(content: bytes, reason: str) -> None:
    assert given_mask(content, "mine.png") == Absent("mine.png", reason)
