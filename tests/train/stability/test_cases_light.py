import pytest
import torch
from torch import Tensor

from actorsnerf_train.stability import cases_light
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import judged
from actorsnerf_train.stability.cases_light import light_cases


def test_all_within_their_bounds(bench: Bench) -> None:
    rows = [judged(case, bench.subjects) for case in light_cases()]
    assert [(row.name, row.measured) for row in rows if not row.passed] == []
    assert any("1e+06" in row.name for row in rows)


def test_an_optical_depth_that_overflows_is_found_out(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def careless(density: Tensor, spacing: Tensor, likelihood: Tensor | None) -> Tensor:
        return -torch.log(torch.exp(-density * spacing))

    monkeypatch.setattr(cases_light, "optical_depth", careless)
    rows = [judged(case, bench.subjects) for case in light_cases() if "soft" not in case.name]
    assert not any(row.passed for row in rows if "1e+06" in row.name)
    assert all(row.passed for row in rows if row.name == "density 1")
