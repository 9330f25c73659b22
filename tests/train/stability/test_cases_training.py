from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import judged
from actorsnerf_train.stability.cases_training import training_cases

FEW = ("no valid ray", "rays, but no survivor", "empty target mask")


def test_hard_steps_are_within_their_bounds(bench: Bench) -> None:
    cases = [case for case in training_cases() if case.name in FEW]
    rows = {case.name: judged(case, bench.subjects) for case in cases}
    assert [name for name, row in rows.items() if not row.passed] == []
    assert rows["no valid ray"].note == "0 rays, 0 survivors"
    assert rows["rays, but no survivor"].note == "256 rays, 0 survivors"
    assert "0 survivors" not in rows["empty target mask"].note.split(", ")


def test_the_step_reaches_every_part(bench: Bench) -> None:
    case = training_cases()[0]
    gradients = case.answer(bench.subjects[1]).gradients
    given = [g for g in gradients if g is not None and bool(g.any())]
    assert len(given) > 0.9 * len(gradients)
