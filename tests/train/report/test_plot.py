from pathlib import Path

from actorsnerf_train.pictures import read_png
from actorsnerf_train.report.plot import write_plot
from actorsnerf_train.report.rows import SpeedReport


def test_the_plot_is_a_picture_and_the_same_every_time(report: SpeedReport, tmp_path: Path) -> None:
    write_plot(tmp_path / "a.png", report)
    write_plot(tmp_path / "b.png", report)
    picture = read_png(tmp_path / "a.png")
    assert picture.shape[0] > 300 and picture.std() > 5
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
