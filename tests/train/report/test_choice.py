from actorsnerf_train.metrics import Scores
from actorsnerf_train.report.choice import Standing, dominated, recommended
from actorsnerf_train.report.errors import ToReference
from actorsnerf_train.report.measure import Spread


def standing(
    name: str, seconds: float, decibel: float, largest: float, truth: Scores | None = None
) -> Standing:
    times = Spread(seconds, 0.9 * seconds, 1.1 * seconds)
    return Standing(name, times, ToReference(largest, largest / 10, decibel, None), truth)


REFERENCE = standing("reference", 100.0, 100.0, 0.0)
EXACT = standing("exact", 2.0, 90.0, 0.003, Scores(25.0, 0.9, 70.0))
HALF = standing("half", 1.0, 45.0, 0.1, Scores(24.95, 0.9, 70.5))
COARSE = standing("coarse", 0.5, 30.0, 0.4, Scores(24.0, 0.9, 75.0))
USELESS = standing("useless", 1.5, 40.0, 0.2, Scores(24.95, 0.9, 70.5))
ALL = [REFERENCE, EXACT, HALF, COARSE, USELESS]


def test_points_nobody_should_use_are_named_with_a_better_one() -> None:
    # The reference is no nearer than what differs by less than a step of 8 bits.
    assert dominated(ALL) == {"reference": "exact", "useless": "half"}


def test_noise_dominates_nobody() -> None:
    twin = standing("twin", 1.95, 90.0, 0.003)  # within the quartiles of exact
    assert dominated([EXACT, twin]) == {}
    nearer = standing("nearer", 0.99, 46.0, 0.1)
    assert dominated([HALF, nearer]) == {"half": "nearer"}


def test_the_fastest_harmless_point_is_recommended() -> None:
    assert recommended(ALL) == "half"
    worse = standing("half", 1.0, 45.0, 0.1, Scores(24.89, 0.9, 70.5))
    assert recommended([REFERENCE, EXACT, worse]) == "exact"
    blurred = standing("half", 1.0, 45.0, 0.1, Scores(24.95, 0.9, 71.5))
    assert recommended([REFERENCE, EXACT, blurred]) == "exact"
    far = standing("half", 1.0, 39.9, 0.1, Scores(25.0, 0.9, 70.0))
    assert recommended([REFERENCE, EXACT, far]) == "exact"
    unknown = standing("half", 1.0, 45.0, 0.1, None)
    assert recommended([REFERENCE, EXACT, unknown]) == "exact"


def test_where_rounding_leaves_no_exact_point_the_nearest_stands_for_them() -> None:
    rounded = standing("exact", 2.0, 74.0, 0.005, Scores(25.0, 0.9, 70.0))
    assert recommended([REFERENCE, rounded, HALF, COARSE]) == "half"
    assert recommended([REFERENCE, rounded, COARSE]) == "exact"
    assert recommended([REFERENCE, standing("exact", 2.0, 90.0, 0.003)]) == "exact"
