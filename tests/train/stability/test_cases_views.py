import pytest
import torch
from torch import Tensor

from actorsnerf_train.stability import cases_views
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import judged
from actorsnerf_train.stability.cases_views import view_cases

FEW = (
    "all looking away",
    "a camera on a vertex",
    "saturated white pictures",
    "behind every camera",
    "outside every picture",
)


def test_hard_views_are_within_their_bounds(bench: Bench) -> None:
    cases = [case for case in view_cases(bench.subjects[0]) if case.name in FEW]
    assert len(cases) == 2 * 3 + 2
    rows = [judged(case, bench.subjects) for case in cases]
    assert [(row.name, row.measured) for row in rows if not row.passed] == []


def test_reading_behind_the_camera_is_found_out(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def mirrored(maps: object, cameras: object, points: Tensor) -> Tensor:
        views, count = points.shape[:2]
        return points.sum() * 0 + points.new_ones(count, views, 1)

    monkeypatch.setattr(cases_views, "read_features", mirrored)
    cases = {case.name: case for case in view_cases(bench.subjects[0])}
    assert not judged(cases["behind every camera"], bench.subjects).passed


def test_the_actors_own_method_is_left_alone(bench: Bench) -> None:
    """Training mode moves running statistics, but of a copy."""
    method = bench.subjects[1].method
    before = {name: buffer.clone() for name, buffer in method.named_buffers()}
    case = next(c for c in view_cases(bench.subjects[0]) if "training" in c.measured)
    judged(case, bench.subjects[1:2])
    assert all(torch.equal(buffer, before[name]) for name, buffer in method.named_buffers())
    assert not method.training
