import dataclasses

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train import result
from actorsnerf_train.result import CameraRow, Evaluation, ImageRow, MeanRow


def test_the_mean_under_a_convention(evaluation: Evaluation) -> None:
    paper, box = MeanRow("paper", 27.7, 0.95, None), MeanRow("box", 20.0, 0.8, 39.8)
    both = dataclasses.replace(evaluation, means=(paper, box))
    assert both.mean("box") == box


def test_a_convention_that_was_not_evaluated_is_a_sentence(evaluation: Evaluation) -> None:
    one = dataclasses.replace(evaluation, means=(MeanRow("paper", 27.7, 0.95, None),))
    with pytest.raises(UserError, match=r"no figures under the convention strict \(it has paper\)"):
        one.mean("strict")


def test_every_field_is_documented() -> None:
    assert result.__doc__ is not None
    for field in dataclasses.fields(Evaluation):
        assert field.name in result.__doc__
    for row in (MeanRow, CameraRow, ImageRow):
        for field in dataclasses.fields(row):
            assert field.name in result.__doc__
