from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.result import CurvePoint
from actorsnerf_train.tables.curves import (
    at_step,
    at_time,
    make_lines,
    make_time_table,
    measured,
    plateau_sentence,
)
from actorsnerf_train.tables.entry import gather

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult

SCORES = (25.0, 0.9, 50.0)


def curve(
    *points: tuple[int, float, float | None], psnr: float = 20.0, frame: int = 30
) -> tuple[CurvePoint, ...]:
    """Of (step, seconds, LPIPS x1000)."""
    return tuple(
        CurvePoint(step, seconds, "box", psnr, 0.8, distance, (("c1", frame),))
        for step, seconds, distance in points
    )


def test_between_two_points_a_curve_is_straight() -> None:
    points = curve((10, 5.0, 90.0), (50, 25.0, 70.0), (100, 45.0, 60.0))
    middle = at_time(points, 20.0)
    assert (middle.step, middle.seconds, middle.lpips_x1000) == (40, 20.0, 75.0)
    assert at_step(points, 75.0).lpips_x1000 == 65.0
    assert at_time(points, 25.0) == points[1]
    assert at_time(points, 1.0) == points[0]
    assert at_time(points, 99.0) == points[2]
    bare = curve((10, 5.0, 90.0), (50, 25.0, None))
    assert at_time(bare, 20.0).lpips_x1000 is None


def test_a_line_is_the_mean_over_actors_and_seeds_at_common_steps(
    write: "WriteResult", tmp_path: Path
) -> None:
    write(SCORES, curve=curve((10, 4.0, 90.0), (100, 40.0, 60.0)), category_seconds=2000.0)
    write(SCORES, curve=curve((10, 6.0, 80.0), (20, 9.0, 7.0), (100, 60.0, 50.0)), seed=1)
    write(SCORES, curve=curve((10, 5.0, 70.0), (100, 50.0, 40.0)), actor="zoe")
    (line,) = make_lines(measured(gather([tmp_path])))
    assert (line.label, line.setting, line.runs) == ("ActorsNeRF", ("fewshot-5", "official"), 3)
    found = [(p.step, p.seconds, p.lpips_x1000) for p in line.points]
    assert found == [(10, 5.0, 80.0), (100, 50.0, 50.0)]
    assert line.category_seconds == 2000.0


def test_lines_are_in_the_order_of_their_shots(write: "WriteResult", tmp_path: Path) -> None:
    for setting in ("short-video", "fewshot-10", "fewshot-5"):
        write(SCORES, curve=curve((10, 4.0, 90.0)), setting=setting)
    found = [line.setting[0] for line in make_lines(measured(gather([tmp_path])))]
    assert found == ["fewshot-5", "fewshot-10", "short-video"]


def test_without_a_common_step_there_is_no_line(write: "WriteResult", tmp_path: Path) -> None:
    write(SCORES, curve=curve((10, 4.0, 90.0)))
    write(SCORES, curve=curve((20, 4.0, 90.0)), seed=1)
    with pytest.raises(UserError, match="setting fewshot-5: its runs' curves have no step in com"):
        make_lines(measured(gather([tmp_path])))


def test_both_budgets_stand_in_one_table(write: "WriteResult", tmp_path: Path) -> None:
    quick = curve((10, 10.0, 90.0), (100, 100.0, 60.0))
    slow = curve((10, 40.0, 100.0), (100, 400.0, 50.0))
    write(SCORES, curve=quick, category_seconds=2000.0)
    write(SCORES, curve=slow, method="humannerf", pretrained_from=None)
    write(SCORES, curve=curve((10, 1.0, 9.0)), setting="short-video")
    table = make_time_table(measured(gather([tmp_path])))
    found = [
        (r.setting, r.budget, r.label, r.steps, r.seconds, r.category_seconds) for r in table.rows
    ]
    assert found == [
        ("fewshot-5", "steps", "ActorsNeRF", (500,), 100.0, 2000.0),
        ("fewshot-5", "steps", "HumanNeRF", (500,), 100.0, None),
        ("fewshot-5", "time", "ActorsNeRF", (100,), 100.0, 2000.0),
        ("fewshot-5", "time", "HumanNeRF", (25,), 100.0, None),
        ("short-video", "steps", "ActorsNeRF", (500,), 100.0, None),
        ("short-video", "time", "ActorsNeRF", (10,), 1.0, None),
    ]
    distances = [
        cell.lpips_x1000.value
        for row in table.rows[:4]
        if (cell := row.cells["eve"]).lpips_x1000 is not None
    ]
    # HumanNeRF after 100 of its 40 ... 400 s: a sixth of the way from 100 to 50.
    assert distances == pytest.approx([60.0, 50.0, 60.0, 100 - 50 / 6])
    assert table.convention == "box"


def test_the_spread_at_equal_time_is_over_seeds(write: "WriteResult", tmp_path: Path) -> None:
    write(SCORES, curve=curve((10, 10.0, 90.0), (100, 100.0, 60.0)))
    write(SCORES, curve=curve((10, 10.0, 90.0), (100, 100.0, 64.0)), seed=1)
    row = make_time_table(measured(gather([tmp_path]))).rows[-1]
    number = row.cells["eve"].lpips_x1000
    assert row.budget == "time" and number is not None
    assert number.value == 62.0 and number.spread == pytest.approx(8**0.5)


def test_other_pictures_are_refused(write: "WriteResult", tmp_path: Path) -> None:
    write(SCORES, seed=2)
    write(SCORES, curve=curve((10, 4.0, 90.0)))
    write(SCORES, curve=curve((10, 4.0, 90.0), frame=32), actor="zoe")
    assert len(measured(gather([tmp_path]))) == 2
    write(SCORES, curve=curve((10, 4.0, 90.0), frame=32), seed=1)
    with pytest.raises(UserError, match="the curve of actor eve was measured on other pictures"):
        measured(gather([tmp_path]))


@pytest.mark.parametrize(
    ("last", "said"),
    [
        (59.5, "plateau reached (the last 20% of 100 steps lowered LPIPS by 0.8%)"),
        (57.0, "**no plateau yet** (the last 20% of 100 steps lowered LPIPS by 5.0%)"),
        (66.0, "plateau reached (the last 20% of 100 steps raised LPIPS by 10.0%)"),
    ],
)
def test_a_plateau_is_said(write: "WriteResult", tmp_path: Path, last: float, said: str) -> None:
    write(SCORES, curve=curve((10, 4.0, 90.0), (80, 32.0, 60.0), (100, 40.0, last)))
    (line,) = make_lines(measured(gather([tmp_path])))
    assert plateau_sentence(line) == f"ActorsNeRF, fewshot-5 (official list): {said}."


def test_without_lpips_nothing_is_said(write: "WriteResult", tmp_path: Path) -> None:
    write(SCORES, curve=curve((10, 4.0, None), (100, 40.0, None)))
    (line,) = make_lines(measured(gather([tmp_path])))
    assert plateau_sentence(line) is None
