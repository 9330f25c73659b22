import math
from dataclasses import replace

import pytest
import torch

from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject, judged, largest_error

BOUNDS = Bounds(1e-12, 1e-6, 1e-3)
THIRD = 1 / 3


def third(subject: Subject) -> Answer:
    """A third, as exact as the precision allows: matrices multiply in bfloat16 there."""
    one = subject.like.new_ones(1, 1)
    return Answer(one @ (one * THIRD))


def exact(subject: Subject) -> Answer:
    return Answer(torch.full((1, 1), THIRD, dtype=torch.float64))


CASE = Case("group", "a third", "its value", BOUNDS, third, exact)


def test_each_precision_has_its_error(bench: Bench) -> None:
    row = judged(CASE, bench.subjects)
    errors = [result.error for result in row.results]
    assert errors[0] == 0
    assert errors[1] is not None and 1e-9 < errors[1] < 1e-7
    assert errors[2] is not None and 1e-4 < errors[2] < 1e-2
    assert row.strain == pytest.approx(errors[2] / 1e-3)
    assert row.passed == (errors[2] <= 1e-3)


def test_an_error_over_its_bound_fails(bench: Bench) -> None:
    assert judged(replace(CASE, bounds=Bounds(0.0, 1e-6, None)), bench.subjects).passed
    assert not judged(replace(CASE, bounds=Bounds(0.0, 1e-9, None)), bench.subjects).passed
    assert not judged(replace(CASE, bounds=Bounds(0.0, 0.0, None)), bench.subjects).passed


def test_without_another_truth_float64_is_it(bench: Bench) -> None:
    row = judged(replace(CASE, truth=None), bench.subjects)
    assert row.results[0].error is None
    assert row.results[1].error is not None and row.results[1].error > 0


@pytest.mark.parametrize("broken", [math.nan, math.inf])
@pytest.mark.parametrize("gradient", [False, True])
def test_what_is_not_finite_fails(bench: Bench, broken: float, gradient: bool) -> None:
    def answer(subject: Subject) -> Answer:
        bad = subject.like.new_tensor([broken if subject.precision == "float32" else 1.0])
        good = torch.ones_like(bad)
        return Answer(good, (bad,)) if gradient else Answer(bad, (good,))

    row = judged(Case("g", "n", "m", Bounds(1.0, 1.0, 1.0), answer), bench.subjects)
    assert not row.passed
    assert [result.finite for result in row.results] == [True, False, True]


def test_gradients_are_compared_by_their_size(bench: Bench) -> None:
    def answer(subject: Subject) -> Answer:
        off = 1.02 if subject.precision == "float32" else 1.0
        return Answer(subject.like.new_zeros(1), (subject.like.new_tensor([3.0, 4.0]) * off, None))

    loose = judged(
        Case("g", "n", "m", Bounds(0.0, 0.0, 0.0, gradient=0.03), answer), bench.subjects
    )
    assert loose.passed
    assert loose.results[1].gradient_error == pytest.approx(0.02, rel=1e-5)
    tight = judged(
        Case("g", "n", "m", Bounds(0.0, 0.0, 0.0, gradient=0.01), answer), bench.subjects
    )
    assert not tight.passed


def test_only_what_counts_is_compared() -> None:
    truth = Answer(torch.tensor([1.0, 2.0]), counted=torch.tensor([True, False]))
    assert largest_error(Answer(torch.tensor([1.5, 9.0])), truth) == 0.5
    assert largest_error(Answer(torch.tensor([math.nan, 9.0])), truth) == math.inf


def test_a_case_that_breaks_off_has_failed(bench: Bench) -> None:
    def answer(subject: Subject) -> Answer:
        raise RuntimeError("sizes do not match\nat all")

    row = judged(Case("g", "n", "m", BOUNDS, answer), bench.subjects)
    assert not row.passed
    assert row.note == "breaks off: sizes do not match"
