"""`curve.jsonl` in a run's folder: how good a fitting was at stated steps, one JSON line each."""

import json
from collections.abc import Sequence
from pathlib import Path

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.checkpoint import write_whole
from actorsnerf_train.journal import keep_log_until
from actorsnerf_train.records import RecordError, from_json, to_json
from actorsnerf_train.result import CurvePoint

CURVE = "curve.jsonl"


def begin_curve(run: Path, first_step: int) -> None:
    """Drop what lies after a step: an interrupted run had gone past its last checkpoint."""
    keep_log_until(run / CURVE, first_step)


def add_point(run: Path, point: CurvePoint) -> None:
    """Write one line, at once."""
    with (run / CURVE).open("a", encoding="utf-8") as stream:
        stream.write(_line(point))


def write_curve(run: Path, points: Sequence[CurvePoint]) -> None:
    """Put these points in the place of those that are there."""
    write_whole(run / CURVE, "".join(map(_line, points)).encode())


def _line(point: CurvePoint) -> str:
    return json.dumps(to_json(point), allow_nan=False) + "\n"


def read_curve(run: Path, last_step: int) -> tuple[CurvePoint, ...] | None:
    """The points of a run up to a step; None where it has no curve.

    Raises:
        UserError: a line is none of this program.
    """
    path = run / CURVE
    if not path.is_file():
        return None
    points = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            points.append(from_json(CurvePoint, json.loads(line), f"{path}: line {number}"))
        except json.JSONDecodeError as error:
            raise UserError(
                f"{path}: line {number} is no JSON ({error}): cut off by a kill? Go on with the "
                "training (the same command), which mends it."
            ) from None
        except RecordError as error:
            raise UserError(str(error)) from None
    return tuple(point for point in points if point.step <= last_step)
