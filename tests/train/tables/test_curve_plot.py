from pathlib import Path

import cv2

from actorsnerf_train.result import CurvePoint
from actorsnerf_train.tables.curve_plot import legend_of, write_curve_plot
from actorsnerf_train.tables.curves import Line


def line(label: str, setting: str, last: float | None, category: float | None = None) -> Line:
    points = tuple(
        CurvePoint(step, 2.0 * step, "box", 20.0, 0.8, distance, ())
        for step, distance in ((10, 90.0), (100, last))
    )
    return Line(label, (setting, "official"), points, 2, category)


def test_each_setting_has_its_row(tmp_path: Path) -> None:
    one, two = tmp_path / "one.png", tmp_path / "two.png"
    five = [line("ActorsNeRF", "fewshot-5", 60.0, 2160.0), line("HumanNeRF", "fewshot-5", 80.0)]
    assert write_curve_plot(one, five)
    assert write_curve_plot(two, [*five, line("HumanNeRF", "short-video", 80.0)])
    low, high = cv2.imread(str(one)), cv2.imread(str(two))
    assert low is not None and high is not None
    assert high.shape == (2 * low.shape[0], *low.shape[1:])
    assert (low < 128).any(), "nothing was drawn"


def test_without_lpips_there_is_nothing_to_draw(tmp_path: Path) -> None:
    assert not write_curve_plot(tmp_path / "no.png", [line("HumanNeRF", "fewshot-5", None)])
    assert not list(tmp_path.iterdir())


def test_the_legend_names_the_time_that_the_axis_leaves_out() -> None:
    ours = line("ActorsNeRF", "fewshot-5", 60.0, 2160.0)
    assert legend_of(ours) == "ActorsNeRF\n(after 2,160 s of category training)"
    assert legend_of(line("HumanNeRF", "fewshot-5", 80.0)) == "HumanNeRF"
