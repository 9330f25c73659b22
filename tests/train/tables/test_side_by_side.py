from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.types import UInt8
from actorsnerf_train.pictures import STRIP_GAP, read_png, strip, write_png
from actorsnerf_train.result import StripLayout, StripRow
from actorsnerf_train.tables.entry import gather
from actorsnerf_train.tables.side_by_side import compose, cut_out, write_side_by_side

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult

SIZES = ((40, 30), (36, 32))
"""Width and height of the strip's two pictures."""
LAYOUT = StripLayout(
    (40, 32),
    STRIP_GAP,
    ("truth", "prediction", "error"),
    tuple(StripRow("c1", 30 + i, *size) for i, size in enumerate(SIZES)),
)


def plain(level: int, size: tuple[int, int]) -> UInt8:
    return np.full((size[1], size[0], 3), level, dtype=np.uint8)


def draw(result: Path, prediction: int) -> None:
    """The strip beside a result: truth 200, prediction as asked, error 7; 10 more in row two."""
    rows = [
        [plain(level + 10 * i, size) for level in (200, prediction, 7)]
        for i, size in enumerate(SIZES)
    ]
    write_png(result.parent / "strip.png", strip(rows))


def test_a_picture_is_cut_out_by_name(write: "WriteResult", tmp_path: Path) -> None:
    draw(write((25.0, 0.9, 50.0), strip=LAYOUT), 90)
    (entry,) = gather([tmp_path])
    assert np.array_equal(cut_out(entry, ("c1", 31), "prediction"), plain(100, SIZES[1]))
    assert np.array_equal(cut_out(entry, ("c1", 30), "truth"), plain(200, SIZES[0]))


def test_truth_and_methods_stand_side_by_side(write: "WriteResult", tmp_path: Path) -> None:
    draw(write((25.0, 0.9, 50.0), strip=LAYOUT, seed=1), 10)
    draw(write((25.0, 0.9, 50.0), strip=LAYOUT, seed=0), 90)
    draw(write((25.0, 0.9, 60.0), strip=LAYOUT, method="humannerf"), 30)
    write((25.0, 0.9, 60.0), method="neuralbody")  # without pictures
    (path,) = write_side_by_side(tmp_path, gather([tmp_path / "results"]))
    assert path.name == "pictures_eve_fewshot-5_official.png"
    sheet = read_png(path)
    step = 40 + STRIP_GAP
    assert sheet.shape[1] == 3 * step - STRIP_GAP
    first = sheet[sheet.shape[0] - (2 * 32 + STRIP_GAP) :]
    second = first[32 + STRIP_GAP :]
    # truth, ActorsNeRF of the smallest seed, HumanNeRF
    assert [first[5, 5 + step * i, 0] for i in range(3)] == [200, 90, 30]
    assert [second[5, 5 + step * i, 0] for i in range(3)] == [210, 100, 40]
    titles = sheet[: sheet.shape[0] - (2 * 32 + STRIP_GAP)]
    assert all((titles[:, step * i : step * i + 40] < 128).any() for i in range(3))


def test_each_actor_and_setting_has_its_figure(write: "WriteResult", tmp_path: Path) -> None:
    for actor, setting in (("eve", "fewshot-5"), ("zoe", "fewshot-5"), ("eve", "short-video")):
        draw(write((25.0, 0.9, 50.0), strip=LAYOUT, actor=actor, setting=setting), 90)
    paths = write_side_by_side(tmp_path, gather([tmp_path / "results"]))
    assert sorted(path.name for path in paths) == [
        "pictures_eve_fewshot-5_official.png",
        "pictures_eve_short-video_official.png",
        "pictures_zoe_fewshot-5_official.png",
    ]


def test_no_picture_in_common_is_no_figure(write: "WriteResult", tmp_path: Path) -> None:
    other = StripLayout((40, 30), STRIP_GAP, LAYOUT.columns, (StripRow("c9", 30, 40, 30),))
    draw(write((25.0, 0.9, 50.0), strip=LAYOUT), 90)
    draw(write((25.0, 0.9, 60.0), strip=other, method="humannerf"), 30)
    assert compose(gather([tmp_path / "results"])) is None
    assert write_side_by_side(tmp_path, gather([tmp_path / "results"])) == ()


def test_a_strip_of_another_evaluation_is_refused(write: "WriteResult", tmp_path: Path) -> None:
    result = write((25.0, 0.9, 50.0), strip=LAYOUT)
    write_png(result.parent / "strip.png", plain(0, (60, 20)))
    with pytest.raises(UserError, match=r"strip\.png: is 60 x 20 pixels, too small for the rows"):
        write_side_by_side(tmp_path, gather([tmp_path / "results"]))
