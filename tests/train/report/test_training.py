from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import torch

from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.neuralbody import NeuralBodyState
from actorsnerf_model.published_order import PublishedOrder, PublishedState
from actorsnerf_model.states import FieldValues, Located, PoseState
from actorsnerf_train.checkpoint import Stage
from actorsnerf_train.losses import Perceptual
from actorsnerf_train.report.training import Step, largest_error, make_step, training_row
from actorsnerf_train.trained import TrainedActor

if TYPE_CHECKING:
    from tests.train.report.conftest import People


@pytest.fixture(params=["pretrain", "fewshot"])
def step(
    request: pytest.FixtureRequest,
    trained: TrainedActor[ActorsNeRFState],
    people: "People",
) -> Step:
    stage: Stage = request.param
    return make_step(stage, trained, people.eve, Perceptual(None), 0)


def test_both_ways_have_the_same_loss_and_gradients(step: Step) -> None:
    row = training_row(step, 1)
    patches = 1 if step.stage == "fewshot" else 2  # as it was fitted; as the preset has it
    assert row.stage == step.stage and (row.patches, row.side) == (patches, 32)
    assert row.loss_difference < 1e-5
    assert row.gradient_error < 1e-3, row.worst_parameter
    assert row.seconds.median > 0 and row.reference_seconds.median > 0
    assert row.faster == row.reference_seconds.median / row.seconds.median


def test_neural_body_has_the_references_gradients_too(
    neuralbody: TrainedActor[NeuralBodyState], people: "People"
) -> None:
    """Those of the frame's own code among them."""
    step = make_step("fewshot", neuralbody, people.eve, Perceptual(None), 0)
    row = training_row(step, 1)
    assert row.loss_difference < 1e-5
    assert row.gradient_error < 1e-3, row.worst_parameter
    assert step.gradients()["codes.frames"].abs().max() > 0


def test_the_reference_alone_asks_the_published_order(
    step: Step, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    field = PublishedOrder.field

    def noted(
        self: PublishedOrder, actor: PublishedState, pose: PoseState, located: Located
    ) -> FieldValues:
        asked.append(located.index.shape[0])
        return field(self, actor, pose, located)

    monkeypatch.setattr(PublishedOrder, "field", noted)
    step.ours()
    assert asked == []
    step.reference()
    assert sum(asked) == step.sample.patches[..., 0].numel() * step.samples_per_ray


def test_each_stage_trains_its_own_parts_and_keeps_the_weights(step: Step) -> None:
    before = {name: p.clone() for name, p in step.objective.method.named_parameters()}
    step.ours()
    ours = step.gradients()
    step.reference()
    theirs = step.gradients()
    assert ours.keys() == theirs.keys()
    learns = {name.split(".")[0] for name in ours}
    assert "radiance" in learns and ("encoder" in learns) == (step.stage == "pretrain")
    assert sum(float(gradient.abs().sum()) for gradient in ours.values()) > 0
    for name, parameter in step.objective.method.named_parameters():
        assert torch.equal(parameter, before[name])


def test_errors_are_relative_to_each_tensors_norm() -> None:
    expected = {"a": torch.tensor([3.0, 4.0]), "b": torch.tensor([100.0])}
    found = {"a": torch.tensor([3.0, 4.5]), "b": torch.tensor([101.0])}
    name, error = largest_error(found, expected)
    assert name == "a" and error == pytest.approx(0.1)
    assert largest_error({"a": expected["a"]}, expected) == ("b", 1.0)
    assert largest_error(expected, {"a": expected["a"]}) == ("b", 1.0)
    zero = {"a": torch.zeros(2)}
    assert largest_error({}, zero)[1] == 0.0


def test_the_step_is_on_the_fitted_actor(
    trained: TrainedActor[ActorsNeRFState], people: "People", tmp_path: Path
) -> None:
    step = make_step("fewshot", trained, people.eve, Perceptual(None), 0)
    assert step.sample.target.actor == "eve"
    assert [view.frame for view in step.sample.supports] == [
        view.frame for view in trained.supports
    ]
    assert step.samples_per_ray == trained.config.render.samples
