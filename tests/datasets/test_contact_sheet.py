import sys
from pathlib import Path

import numpy as np
import pytest

from actorsnerf_datasets.cameras import project
from actorsnerf_datasets.contact_sheet import LABEL_HEIGHT, contact_sheet, write_contact_sheet
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile


@pytest.fixture
def sequence(sequence_path: Path) -> SequenceFile:
    """A good sequence; its pictures are 48 x 64."""
    pytest.importorskip("cv2", reason="OpenCV, of the preprocess extra, draws")
    return SequenceFile(sequence_path)


def test_one_tile_per_frame_and_camera_wide_enough_for_its_label(sequence: SequenceFile) -> None:
    """The widest label takes 67 pixels, so pictures of 48 are drawn twice as large."""
    assert contact_sheet(sequence, 4, 9).shape == (4 * (128 + LABEL_HEIGHT), 3 * 96, 3)
    assert contact_sheet(sequence, 99, 2).shape == (12 * (128 + LABEL_HEIGHT), 2 * 96, 3)
    assert contact_sheet(sequence, 1, 1).shape == (128 + LABEL_HEIGHT, 96, 3)


def test_wide_pictures_keep_their_size(
    sequence: SequenceFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("actorsnerf_datasets.contact_sheet.LABEL_SCALE", 0.4)
    assert contact_sheet(sequence, 1, 2).shape == (64 + LABEL_HEIGHT, 2 * 48, 3)


def test_bones_are_drawn_where_the_joints_project(sequence: SequenceFile) -> None:
    sheet = contact_sheet(sequence, 1, 1)[LABEL_HEIGHT::2, ::2]
    joints = sequence.header.fits.posed_joints[0]
    pixels = project(joints, sequence.crop_K(0, 0), sequence.camera_from_body(0, 0)).pixels
    x, y = np.rint((pixels[1] + pixels[4]) / 2).astype(int)  # the left thigh
    near = sheet[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3).astype(int)
    assert abs(near - [255, 128, 0]).sum(axis=1).min() < 60
    green = (sheet == [0, 255, 0]).all(axis=-1)
    assert green.sum() > 50


def test_a_missing_picture_is_a_dark_tile(sequence: SequenceFile) -> None:
    sheet = contact_sheet(sequence, 99, 3)
    assert (sheet[-64:, -48:] == 32).all()


def test_the_png_holds_the_sheet(sequence: SequenceFile, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2", reason="reads the PNG")
    write_contact_sheet(sequence, tmp_path / "sheet.png", frames=2, cameras=2)
    found = cv2.imread(str(tmp_path / "sheet.png"))[..., ::-1]
    np.testing.assert_array_equal(found, contact_sheet(sequence, 2, 2))
    with pytest.raises(UserError, match=r"the contact sheet cannot be written \(No such file"):
        write_contact_sheet(sequence, tmp_path / "no" / "sheet.png")


def test_without_opencv_the_extra_is_named(
    sequence: SequenceFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(UserError, match=r"pip install 'actorsnerf\[preprocess\]'"):
        write_contact_sheet(sequence, tmp_path / "sheet.png")
    assert list(tmp_path.glob("*.png*")) == []
