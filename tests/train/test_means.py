import math

import pytest
import torch

from actorsnerf_model.states import Counts
from actorsnerf_train.losses import Losses
from actorsnerf_train.means import Means
from actorsnerf_train.objective import Outcome


def outcome(loss: float, inside: float) -> Outcome:
    terms = [torch.tensor(value, requires_grad=True) for value in (loss, loss / 2, 0.1, 0.0)]
    return Outcome(
        Losses(*terms), torch.tensor(inside), torch.tensor(0.25), Counts(10, 100, 20, 15)
    )


def test_means_by_hand() -> None:
    means = Means()
    pulse = means.add(outcome(1.0, 0.5))
    assert (pulse.loss, pulse.inside, pulse.samples, pulse.survivors) == (1.0, 0.5, 100, 20)
    assert math.isnan(means.add(outcome(3.0, math.nan)).inside)
    entry = means.entry(7, "ann", 0.9, 2.0, 30.0)
    assert (entry.loss, entry.perceptual, entry.inside) == (2.0, 1.0, 0.5)
    assert entry.squared_error == pytest.approx(0.1)
    assert (entry.survivors, entry.step, entry.seconds) == (0.2, 7, 30.0)


def test_counting_begins_anew_after_an_entry() -> None:
    means = Means()
    means.add(outcome(100.0, 0.5))
    means.entry(1, "ann", 1.0, 0.0, 1.0)
    means.add(outcome(1.0, 0.75))
    assert means.entry(2, "ann", 1.0, 0.0, 2.0).loss == 1.0


def test_nothing_counted_is_no_number() -> None:
    assert math.isnan(Means().entry(1, "ann", 1.0, 0.0, 1.0).loss)
