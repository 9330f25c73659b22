import json
from pathlib import Path

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.curve_file import CURVE, add_point
from actorsnerf_train.report.learning import learning_rows, levels, reached
from actorsnerf_train.report.measure import Spread
from actorsnerf_train.report.rows import TrainingRow
from actorsnerf_train.result import CurvePoint


def point(step: int, seconds: float, psnr: float) -> CurvePoint:
    return CurvePoint(step, seconds, "box", psnr, 0.9, None, (("camera1", 4),))


CURVE_POINTS = (point(10, 5.0, 18.5), point(50, 25.0, 20.5), point(100, 50.0, 20.25))


def training(stage: str, faster: float) -> TrainingRow:
    spread = Spread(1.0, 1.0, 1.0)
    return TrainingRow(stage, 2, 32, 64, spread, spread, faster, 0.0, 0.0, "a")


def test_levels_are_whole_decibels_between_the_first_and_the_best() -> None:
    assert levels(CURVE_POINTS) == [18.5, 19.0, 20.0, 20.5]
    assert levels(CURVE_POINTS[:1]) == [18.5]
    assert levels((point(1, 1.0, 19.0), point(2, 2.0, 21.0))) == [19.0, 20.0, 21.0]


def test_between_two_points_the_curve_is_straight() -> None:
    assert reached(CURVE_POINTS, 18.0) == (10, 5.0)
    assert reached(CURVE_POINTS, 19.5) == (30, 15.0)
    assert reached(CURVE_POINTS, 20.5) == (50, 25.0)


def test_the_reference_takes_as_many_steps_at_its_own_pace(tmp_path: Path) -> None:
    assert learning_rows(tmp_path, 100, ()) == ()
    for one in CURVE_POINTS:
        add_point(tmp_path, one)
    rows = learning_rows(tmp_path, 100, (training("pretrain", 9.0), training("fewshot", 4.0)))
    assert [(row.psnr, row.seconds, row.reference_seconds) for row in rows] == [
        (18.5, 5.0, 20.0),
        (19.0, 10.0, 40.0),
        (20.0, 20.0, 80.0),
        (20.5, 25.0, 100.0),
    ]
    assert learning_rows(tmp_path, 100, ())[0].reference_seconds is None
    assert [row.psnr for row in learning_rows(tmp_path, 20, ())] == [18.5]


def test_a_spoiled_curve_is_refused(tmp_path: Path) -> None:
    (tmp_path / CURVE).write_text(json.dumps({"step": "ten"}) + "\n")
    with pytest.raises(UserError, match=r"curve.jsonl: line 1"):
        learning_rows(tmp_path, 100, ())
