from pathlib import Path

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.curve_file import CURVE, add_point, begin_curve, read_curve, write_curve
from actorsnerf_train.result import CurvePoint


def point(step: int) -> CurvePoint:
    return CurvePoint(step, 1.5 * step, "box", 20.0, 0.9, None, (("camera1", 24),))


def test_points_come_back_up_to_a_step(tmp_path: Path) -> None:
    for step in (2, 4, 8):
        add_point(tmp_path, point(step))
    assert read_curve(tmp_path, 4) == (point(2), point(4))
    assert read_curve(tmp_path, 1) == ()


def test_points_take_the_place_of_others(tmp_path: Path) -> None:
    add_point(tmp_path, point(4))
    write_curve(tmp_path, [point(2), point(4)])
    assert read_curve(tmp_path, 9) == (point(2), point(4))


def test_no_curve_is_none(tmp_path: Path) -> None:
    begin_curve(tmp_path, 3)
    assert list(tmp_path.iterdir()) == []
    assert read_curve(tmp_path, 3) is None


def test_going_on_drops_later_points_and_a_torn_line(tmp_path: Path) -> None:
    for step in (2, 4, 8):
        add_point(tmp_path, point(step))
    with (tmp_path / CURVE).open("a") as stream:
        stream.write('{"step": 9, "sec')
    with pytest.raises(UserError, match=r"curve\.jsonl: line 4 is no JSON .*Go on with the train"):
        read_curve(tmp_path, 8)
    begin_curve(tmp_path, 4)
    assert read_curve(tmp_path, 99) == (point(2), point(4))


def test_a_foreign_line_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / CURVE).write_text('{"step": 1}\n')
    with pytest.raises(UserError, match=r"curve\.jsonl: line 1 has no convention"):
        read_curve(tmp_path, 9)
