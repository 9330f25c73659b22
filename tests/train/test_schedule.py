import pytest

from actorsnerf_train.schedule import Schedule, count, due, open_bands, rate_factor

OFFICIAL = Schedule(steps=200_000)
OFFICIAL_FEWSHOT = Schedule(steps=300_000, first_count=100_000, last_count=400_000)


def test_official_counts_are_the_steps() -> None:
    for step in (0, 1, 777, 200_000):
        assert count(OFFICIAL, step) == pytest.approx(step)
    assert count(OFFICIAL_FEWSHOT, 0) == 100_000
    assert count(OFFICIAL_FEWSHOT, 300_000) == 400_000


def test_rates_decay_to_a_tenth_in_500_000_counts() -> None:
    assert rate_factor(OFFICIAL, 0) == 1
    assert rate_factor(OFFICIAL, 200_000) == pytest.approx(10 ** (-200 / 500))
    assert rate_factor(OFFICIAL_FEWSHOT, 0) == pytest.approx(10 ** (-1 / 5))
    long = Schedule(steps=10, last_count=500_000)
    assert rate_factor(long, 10) == pytest.approx(0.1)


def test_deformation_kicks_in_at_10k_and_is_open_at_50k() -> None:
    assert open_bands(OFFICIAL, 10_000, 6) == 0
    assert 0 < open_bands(OFFICIAL, 10_001, 6) < 1e-3
    assert open_bands(OFFICIAL, 30_000, 6) == pytest.approx(3)
    assert open_bands(OFFICIAL, 50_000, 6) == 6
    assert open_bands(OFFICIAL, 200_000, 6) == 6


def test_few_shot_fitting_begins_with_everything_open() -> None:
    assert open_bands(OFFICIAL_FEWSHOT, 0, 6) == 6


@pytest.mark.parametrize("steps", [40, 377, 5000])
def test_short_runs_pass_the_same_fractions(steps: int) -> None:
    short = Schedule(steps=steps)
    for share in (0.0, 0.05, 0.1, 0.25, 0.7, 1.0):
        official, own = int(share * 200_000), share * steps
        if own == int(own):
            assert rate_factor(short, int(own)) == pytest.approx(rate_factor(OFFICIAL, official))
            assert open_bands(short, int(own), 6) == pytest.approx(
                open_bands(OFFICIAL, official, 6)
            )
    assert open_bands(short, steps - 1, 6) == 6


@pytest.mark.parametrize(("steps", "first", "last"), [(0, 0, 1), (5, 10, 10), (5, -1, 10)])
def test_impossible_schedules_are_refused(steps: int, first: int, last: int) -> None:
    with pytest.raises(ValueError, match="a schedule needs steps > 0"):
        Schedule(steps=steps, first_count=first, last_count=last)


def test_nothing_is_due_every_zero_steps_but_at_the_end() -> None:
    assert [step for step in range(1, 6) if due(step, 0, 5)] == [5]
