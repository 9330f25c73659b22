import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_preprocess.image_files import ImageReader, PictureFiles, picture_size
from actorsnerf_preprocess.source import Absent, MaskProbe, RawPicture


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    image = np.zeros((20, 30, 3), np.uint8)
    image[..., 2] = 200  # OpenCV's order: red
    cv2.imwrite(str(tmp_path / "a.png"), image)
    for name, columns in (("m.png", slice(3, 6)), ("n.png", slice(5, 9))):
        mask = np.zeros((20, 30), np.uint8)
        mask[:, columns] = 13
        cv2.imwrite(str(tmp_path / name), mask)
    return tmp_path


def reader(folder: Path, *masks: str, image: str = "a.png") -> ImageReader:
    return ImageReader(folder, {(0, 0): PictureFiles(image, masks)}, ((30, 20),))


def read(folder: Path, *masks: str, image: str = "a.png") -> RawPicture | Absent:
    return next(reader(folder, *masks, image=image).read_many(0, [0]))


def test_pictures_are_rgb_and_masks_a_union_of_what_is_not_zero(folder: Path) -> None:
    picture = read(folder, "m.png", "n.png")
    assert isinstance(picture, RawPicture) and picture.mask is not None
    assert picture.image[0, 0].tolist() == [200, 0, 0]
    assert picture.mask[0].tolist() == [0] * 3 + [255] * 6 + [0] * 21


def test_the_probe_reads_the_same_mask_and_digests_all_bytes(folder: Path) -> None:
    one, both = (reader(folder, *names).probe(0, 0) for names in (("m.png",), ("m.png", "n.png")))
    assert isinstance(one, MaskProbe) and isinstance(both, MaskProbe)
    assert one.digest != both.digest
    picture = read(folder, "m.png")
    assert isinstance(picture, RawPicture)
    assert one.mask is not None and picture.mask is not None
    assert np.array_equal(one.mask, picture.mask)


def test_masks_of_the_user_stay_soft(folder: Path) -> None:
    mask = np.zeros((20, 30), np.uint8)
    mask[:, :7] = [0, 1, 3, 40, 128, 250, 255]
    cv2.imwrite(str(folder / "m.png"), mask)
    files = PictureFiles("a.png", ("m.png",), given=True)
    soft = ImageReader(folder, {(0, 0): files}, ((30, 20),))
    probed = soft.probe(0, 0)
    picture = next(soft.read_many(0, [0]))
    assert isinstance(probed, MaskProbe) and isinstance(picture, RawPicture)
    for found in (probed.mask, picture.mask):
        assert found is not None and np.array_equal(found, mask)
    cv2.imwrite(str(folder / "m.png"), mask // 20)
    refused = soft.probe(0, 0)
    assert isinstance(refused, Absent) and "labels of body parts" in refused.reason


def test_a_mask_of_another_size_is_scaled_if_it_has_the_same_proportions(folder: Path) -> None:
    mask = np.zeros((40, 60), np.uint8)
    mask[:, 20:40] = 1
    cv2.imwrite(str(folder / "m.png"), mask)
    picture = read(folder, "m.png")
    assert isinstance(picture, RawPicture) and picture.mask is not None
    assert picture.mask[0].tolist() == [0] * 10 + [255] * 10 + [0] * 10
    cv2.imwrite(str(folder / "m.png"), mask[:, :50])
    refused = read(folder, "m.png")
    assert refused == Absent(str(folder / "m.png"), "mask of 50 x 40 for a picture of 30 x 20")


def test_what_cannot_be_read_is_named(folder: Path) -> None:
    content = (folder / "a.png").read_bytes()
    (folder / "cut.png").write_bytes(content[:-20])
    jpeg = cv2.imencode(".jpg", np.zeros((20, 30, 3), np.uint8))[1].tobytes()
    (folder / "cut.jpg").write_bytes(bytes(jpeg)[:-300])
    (folder / "text.png").write_text("no picture")
    (folder / "empty.png").write_bytes(b"")
    cv2.imwrite(str(folder / "small.png"), np.zeros((10, 30, 3), np.uint8))
    cases = {
        "cut.png": "truncated",
        "cut.jpg": "truncated",
        "text.png": "not a readable picture",
        "empty.png": "truncated",
        "small.png": "30 x 10 instead of 30 x 20",
        "gone.png": "missing",
    }
    for name, reason in cases.items():
        assert read(folder, "m.png", image=name) == Absent(str(folder / name), reason)
    assert read(folder, "text.png") == Absent(str(folder / "text.png"), "not a readable mask")


def test_a_picture_without_a_mask_is_absent_in_the_probe(folder: Path) -> None:
    assert reader(folder).probe(0, 0) == Absent(str(folder / "a.png"), "no mask")


def test_the_reader_travels_to_other_processes(folder: Path) -> None:
    copy = pickle.loads(pickle.dumps(reader(folder, "m.png")))
    assert copy.files(0, 0) == (folder / "a.png", folder / "m.png")


def test_picture_size(folder: Path) -> None:
    assert picture_size(folder / "a.png") == (30, 20)
    (folder / "text.png").write_text("no picture")
    assert picture_size(folder / "text.png") is None
