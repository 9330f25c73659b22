"""When a fitting reached a quality: its own curve, and what the reference's steps would have taken.

Only for runs that were measured as they learned (`fewshot --curve`; `tables` asks for it always).
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from actorsnerf_train.curve_file import read_curve
from actorsnerf_train.report.rows import LearningRow, TrainingRow
from actorsnerf_train.result import CurvePoint


def learning_rows(
    run: Path, last_step: int, steps: Sequence[TrainingRow]
) -> tuple[LearningRow, ...]:
    """Every whole decibel that the curve rose through, its first point and its best.

    Args:
        run: folder of the fitting; without a curve there are no rows.
        last_step: of the checkpoint.
        steps: measured training steps; the few-shot one's ratio foretells the reference's time.

    Raises:
        UserError: the curve is no such file.
    """
    curve = read_curve(run, last_step)
    if not curve:
        return ()
    slower = next((row.faster for row in steps if row.stage == "fewshot"), None)
    rows = []
    for psnr in levels(curve):
        step, seconds = reached(curve, psnr)
        other = None if slower is None else slower * seconds
        rows.append(LearningRow(psnr, step, seconds, other))
    return tuple(rows)


def levels(curve: Sequence[CurvePoint]) -> list[float]:
    """The first point's PSNR, whole decibels above it, and the best.

    Args:
        curve: in the order of its steps.
    """
    first, best = curve[0].psnr, max(point.psnr for point in curve)
    whole = range(math.floor(first) + 1, math.ceil(best))
    return [first, *map(float, whole), *([best] if best > first else [])]


def reached(curve: Sequence[CurvePoint], psnr: float) -> tuple[int, float]:
    """The step and the seconds of training at which a curve first reaches a PSNR.

    Between two points the curve counts as straight.

    Args:
        curve: in the order of its steps.
        psnr: not above the best of it.
    """
    if curve[0].psnr >= psnr:
        return curve[0].step, curve[0].seconds
    before, after = next(pair for pair in pairwise(curve) if pair[1].psnr >= psnr)
    share = (psnr - before.psnr) / (after.psnr - before.psnr)
    step = before.step + share * (after.step - before.step)
    return round(step), before.seconds + share * (after.seconds - before.seconds)


__all__ = ["learning_rows", "levels", "reached"]
