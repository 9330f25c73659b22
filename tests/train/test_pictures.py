import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.pictures import (
    STRIP_GAP,
    error_picture,
    is_own,
    read_png,
    strip,
    to_bytes,
    write_depth,
    write_png,
    write_video,
)


def test_levels_are_rounded_and_clipped() -> None:
    picture = torch.tensor([[[-0.2, 0.0, 1.5], [0.5, 1 / 255, 0.4 / 255]]])
    assert to_bytes(picture).tolist() == [[[0, 0, 255], [128, 1, 0]]]


def test_png_keeps_the_order_of_channels(tmp_path: Path, rng: np.random.Generator) -> None:
    picture = rng.integers(0, 256, size=(5, 7, 3), dtype=np.uint8)
    write_png(tmp_path / "a.png", picture)
    assert np.array_equal(read_png(tmp_path / "a.png"), picture)
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def test_grey_png(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", np.array([[0, 200]], dtype=np.uint8))
    assert read_png(tmp_path / "a.png").tolist() == [[[0] * 3, [200] * 3]]


def test_depth_counts_millimetres(tmp_path: Path) -> None:
    write_depth(tmp_path / "d.png", torch.tensor([[0.0, 1.2344], [1.2346, 99.0]]))
    found = cv2.imread(str(tmp_path / "d.png"), cv2.IMREAD_UNCHANGED)
    assert found is not None
    assert found.dtype == np.uint16
    assert found.tolist() == [[0, 1234], [1235, 65535]]


def test_what_is_written_here_is_known_by_itself(tmp_path: Path) -> None:
    own, other, short = (tmp_path / name for name in ("own.png", "other.png", "short.png"))
    write_png(own, np.zeros((2, 3), dtype=np.uint8))
    cv2.imwrite(str(other), np.zeros((2, 3), dtype=np.uint8))
    short.write_bytes(own.read_bytes()[:40])
    assert is_own(own)
    assert not any(map(is_own, (other, short, tmp_path, tmp_path / "none.png")))
    assert read_png(own).shape == (2, 3, 3)
    kinds, content = [], own.read_bytes()[8:]
    while content:
        end = 8 + int.from_bytes(content[:4], "big")
        kinds.append(content[4:8])
        assert zlib.crc32(content[4:end]) == int.from_bytes(content[end : end + 4], "big")
        content = content[end + 4 :]
    assert kinds[:2] == [b"IHDR", b"tEXt"] and kinds[-1] == b"IEND"


@pytest.mark.parametrize("content", [b"", b"no picture"])
def test_a_damaged_picture_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(UserError, match=r"a\.png: cannot be read as a picture"):
        read_png(tmp_path / "a.png")


def test_a_missing_picture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such picture"):
        read_png(tmp_path / "a.png")


def test_video_has_all_pictures_in_order_without_the_odd_edge(tmp_path: Path) -> None:
    levels = (20, 120, 220)
    write_video(tmp_path / "v.mp4", (np.full((33, 65, 3), n, np.uint8) for n in levels), 10.0)
    video = cv2.VideoCapture(str(tmp_path / "v.mp4"))
    frames = []
    while (read := video.read())[0]:
        frames.append(read[1])
    assert [frame.shape for frame in frames] == [(32, 64, 3)] * 3
    assert [frame.mean() for frame in frames] == pytest.approx(levels, abs=6)
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)
    assert [p.name for p in tmp_path.iterdir()] == ["v.mp4"]


def test_a_video_that_lacks_pictures_is_no_video(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the disk is full, which OpenCV's writer keeps to itself."""

    class Reader:
        def __init__(self, path: str) -> None:
            self.isOpened, self.release = Path(path).exists, list

        def get(self, _: int) -> float:
            return 2.0

    monkeypatch.setattr(cv2, "VideoCapture", Reader)
    pictures = (np.full((32, 64, 3), n, np.uint8) for n in (20, 40, 220))
    with pytest.raises(OSError, match="only 2 of 3 pictures could be written"):
        write_video(tmp_path / "v.mp4", pictures, 10.0)
    assert not list(tmp_path.iterdir())


def test_video_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no pictures to make a video of"):
        write_video(tmp_path / "v.mp4", [], 10.0)
    assert not list(tmp_path.iterdir())


def test_error_picture_is_dark_where_right_and_bright_where_wrong() -> None:
    truth = torch.zeros(1, 3, 3)
    made = torch.zeros(1, 3, 3)
    made[0, 1], made[0, 2] = 0.1, 0.25
    brightness = error_picture(truth, made).astype(int).sum(axis=2)[0]
    assert brightness[0] < 20 < brightness[1] < brightness[2]


def test_strip_sets_rows_and_columns() -> None:
    small = np.zeros((2, 3, 3), np.uint8)
    large = np.full((4, 5, 3), 7, np.uint8)
    sheet = strip([[large, small], [large]])
    assert sheet.shape == (8 + STRIP_GAP, 10 + STRIP_GAP, 3)
    assert (sheet[:4, :5] == 7).all() and (sheet[4 + STRIP_GAP :, :5] == 7).all()
    assert (sheet[:2, 5 + STRIP_GAP : 8 + STRIP_GAP] == 0).all()
    assert (sheet[4 + STRIP_GAP :, 5:] == 255).all() and (sheet[4 : 4 + STRIP_GAP] == 255).all()
