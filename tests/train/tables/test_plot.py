from pathlib import Path
from typing import TYPE_CHECKING

import cv2

from actorsnerf_train.tables.entry import gather
from actorsnerf_train.tables.plot import write_plot
from actorsnerf_train.tables.table import make_table

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult


def test_few_shot_rows_are_drawn(write: "WriteResult", tmp_path: Path) -> None:
    for shots, distance in ((5, 60.0), (30, 50.0)):
        write((25.0, 0.9, distance), setting=f"fewshot-{shots}")
    path = tmp_path / "plot.png"
    assert write_plot(path, make_table(gather([tmp_path / "results"]), "box"))
    picture = cv2.imread(str(path))
    assert picture is not None
    assert (picture < 128).any(), "nothing was drawn"


def test_one_number_of_shots_is_no_line(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.9, 60.0))
    write((25.0, 0.9, 60.0), seed=1)
    path = tmp_path / "plot.png"
    assert not write_plot(path, make_table(gather([tmp_path / "results"]), "box"))
    assert not path.exists()


def test_without_lpips_there_is_nothing_to_draw(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.9, None))
    write((25.0, 0.9, 50.0), setting="short-video")
    path = tmp_path / "plot.png"
    assert not write_plot(path, make_table(gather([tmp_path / "results"]), "box"))
    assert not path.exists()
