from dataclasses import replace
from pathlib import Path

import pytest
import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.published_order import PublishedOrder
from actorsnerf_train.report.contestants import (
    chosen_points,
    contestant_of,
    refuse_strangers,
    shows,
)
from actorsnerf_train.report.points import POINTS, named_point
from actorsnerf_train.trained import TrainedActor, load_actor


def test_points_can_be_chosen() -> None:
    assert chosen_points(()) == POINTS
    assert [point.name for point in chosen_points(("fast",))] == [
        "reference",
        "complete",
        "exact",
        "fast",
    ]


def test_a_baked_file_goes_with_its_checkpoint_not_with_the_persons_name(fewshot_run: Path) -> None:
    fitted = load_actor(fewshot_run, torch.device("cpu"))
    other = replace(fitted, info=replace(fitted.info, tensors_sha256="0" * 64))
    assert shows(fitted, fitted)
    assert not shows(other, fitted)
    refuse_strangers([other, fitted], [fitted])
    with pytest.raises(UserError, match=f"shows {fitted.actor} as another checkpoint than"):
        refuse_strangers([other], [fitted])


def test_the_reference_alone_asks_the_published_order(
    trained: TrainedActor[ActorsNeRFState],
) -> None:
    reference = contestant_of(trained, named_point("reference")).actor
    assert isinstance(reference.method, PublishedOrder)
    assert reference.state.actor.window == trained.state.window
    assert not isinstance(contestant_of(trained, named_point("exact")).actor.method, PublishedOrder)
