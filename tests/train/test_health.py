import math

import pytest

from actorsnerf_train.health import Health, HealthLimits, Pulse, TrainingError

LIMITS = HealthLimits(window=3, grace=2)
GOOD = Pulse(loss=0.5, inside=0.9, outside=0.1, samples=10, survivors=5)


def test_a_living_training_is_left_alone() -> None:
    health = Health(LIMITS)
    for step in range(20):
        health.check(GOOD, step, "ann")


@pytest.mark.parametrize("loss", [math.nan, math.inf])
def test_a_loss_that_is_no_number_stops_at_once(loss: float) -> None:
    bad = Pulse(loss, 0.9, 0.1, 10, 5)
    with pytest.raises(TrainingError, match=r"step 7: the loss of actor ann is (nan|inf); likely"):
        Health(LIMITS).check(bad, 7, "ann")


def test_no_ray_in_the_box_is_said() -> None:
    with pytest.raises(TrainingError, match="no ray of actor ann's patches meets the body's box"):
        Health(LIMITS).check(Pulse(0.5, 0.9, 0.1, 0, 0), 0, "ann")


def test_a_vanished_actor_stops_after_the_window_and_the_grace() -> None:
    health = Health(LIMITS)
    empty = Pulse(0.5, 0.001, 0.0, 10, 5)
    health.check(empty, 0, "ann")
    health.check(empty, 1, "ann")
    with pytest.raises(TrainingError, match=r"step 2: the actor has vanished \(mean opacity 0.001"):
        health.check(empty, 2, "ann")


def test_the_last_step_is_judged_by_what_there_is() -> None:
    health = Health(LIMITS)
    health.check(Pulse(0.5, 0.001, 0.0, 10, 5), 9, "ann")  # gone on from a checkpoint
    with pytest.raises(TrainingError, match=r"vanished .* over the last 1 steps"):
        health.conclude(9)
    early = Health(LIMITS)
    early.check(Pulse(0.5, 0.001, 0.0, 10, 5), 1, "ann")
    early.conclude(1)
    healthy = Health(LIMITS)
    healthy.check(GOOD, 9, "ann")
    healthy.conclude(9)


def test_fog_stops_too() -> None:
    health = Health(LIMITS)
    with pytest.raises(TrainingError, match="filled with fog"):
        for step in range(5):
            health.check(Pulse(0.5, 0.99, 0.99, 10, 5), step, "ann")


def test_patches_without_the_person_count_neither_way() -> None:
    health = Health(LIMITS)
    for step in range(20):
        health.check(Pulse(0.5, math.nan, 0.1, 10, 5), step, "ann")
    assert len(health.inside) == 0


def test_one_bad_step_in_the_window_is_no_collapse() -> None:
    health = Health(LIMITS)
    for step in range(20):
        health.check(Pulse(0.5, 0.001 if step % 3 else 0.9, 0.1, 10, 5), step, "ann")
