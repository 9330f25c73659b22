import pytest
import torch
from torch import Tensor

from actorsnerf_train.stability import cases_motion
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import judged
from actorsnerf_train.stability.cases_motion import ANGLES, motion_cases


def test_every_angle_and_every_pose_is_within_its_bounds(bench: Bench) -> None:
    cases = motion_cases(bench.subjects[0])
    assert sum(case.group == "rotation" for case in cases) == 3 * len(ANGLES)
    assert sum("fastest" in case.name for case in cases) == 3
    rows = [judged(case, bench.subjects) for case in cases]
    assert [row.name for row in rows if not row.passed] == []


def test_the_released_formula_is_found_out(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Dividing by the angle plus 1e-5 is no rotation for small angles."""

    def released(axis_angle: Tensor) -> Tensor:
        angle = axis_angle.norm(dim=-1)[..., None, None]
        x, y, z = (axis_angle / (angle[..., 0] + 1e-5)).unbind(-1)
        zero = torch.zeros_like(x)
        rows = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1)
        cross = rows.reshape(*x.shape, 3, 3)
        turned: Tensor = angle.sin() * cross + (1 - angle.cos()) * cross @ cross
        return torch.eye(3).to(cross) + turned

    monkeypatch.setattr(cases_motion, "matrix_from_axis_angle", released)
    rows = {
        (case.name, case.measured): judged(case, bench.subjects)
        for case in motion_cases(bench.subjects[0])
        if case.group == "rotation"
    }
    assert not rows["angle 1e-4", "R against quaternions"].passed
    assert not rows["angle pi", "max abs R R^T - 1"].passed
    derivative = rows["angle 0", "derivative of R against a difference quotient"]
    assert not derivative.passed
