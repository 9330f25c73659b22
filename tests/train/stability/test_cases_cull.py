from dataclasses import replace

import pytest
import torch

from actorsnerf_model.skinning_bounds import locate
from actorsnerf_model.states import Located
from actorsnerf_train.stability import cases_cull
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import judged
from actorsnerf_train.stability.cases_cull import cull_cases

FEW = ("T-pose", "arms through the chest", "collapsed: every joint at pi", "fastest frame 1")


def test_nobody_is_lost(bench: Bench) -> None:
    cases = [case for case in cull_cases(bench.subjects[0]) if case.name in FEW]
    assert len(cases) == 2 * len(FEW)
    rows = [judged(case, bench.subjects) for case in cases]
    assert [row.name for row in rows if not row.passed] == []
    assert all(not row.note.startswith("0 ") for row in rows)


def test_a_test_that_drops_one_point_in_a_hundred_is_found_out(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def careless(*arguments: object) -> Located:
        located: Located = locate(*arguments)  # type: ignore[arg-type]  # passed on as they came
        keep = torch.arange(len(located.index)) % 100 != 0
        return Located(located.index[keep], located.canonical[keep], located.likelihood[keep])

    monkeypatch.setattr(cases_cull, "locate", careless)
    case = next(case for case in cull_cases(bench.subjects[0]) if case.group == "threshold")
    assert not judged(case, bench.subjects[:1]).passed


def test_an_empty_cell_is_found_out(bench: Bench) -> None:
    case = next(case for case in cull_cases(bench.subjects[0]) if case.group == "cull")
    subject = bench.subjects[0]
    body = subject.state.body
    assert body.occupancy is not None
    tables = replace(body.occupancy, peaks=tuple(0.9 * peak for peak in body.occupancy.peaks))
    thin = replace(subject.state, body=replace(body, occupancy=replace(tables, level=-0.05)))
    assert not judged(case, (replace(subject, state=thin),)).passed
