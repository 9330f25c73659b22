from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from actorsnerf_datasets.torch_dataset import Sample
from actorsnerf_model.actor_states import UnreadMap
from actorsnerf_train.config import MethodName, TrainConfig, alone
from actorsnerf_train.loop import Training
from actorsnerf_train.methods import (
    actorsnerf,
    build_method,
    know_actor,
    step_state,
    trunk_of,
    window_at,
)

CPU = torch.device("cpu")


@pytest.fixture
def sample(
    make_training: Callable[[Path, TrainConfig], Training], config: TrainConfig, tmp_path: Path
) -> Sample:
    return make_training(tmp_path, config).source[0]


def test_first_weights_depend_on_the_seed_alone(config: TrainConfig) -> None:
    torch.manual_seed(1)
    state = torch.get_rng_state()
    one = build_method(config, CPU).state_dict()
    assert torch.equal(torch.get_rng_state(), state)
    torch.manual_seed(2)
    two = build_method(config, CPU).state_dict()
    other = build_method(replace(config, seed=1), CPU).state_dict()
    assert all(torch.equal(one[name], two[name]) for name in one)
    assert not torch.equal(one["radiance.colour_out.weight"], other["radiance.colour_out.weight"])


def test_parts_cover_the_method_and_those_switched_off_are_absent(config: TrainConfig) -> None:
    method = build_method(config, CPU)
    inside = {id(p) for part in method.parts().values() for p in part.parameters()}
    assert inside == {id(p) for p in method.parameters()}
    bare = replace(config.actorsnerf, deformation=False, body_features=False)
    assert set(build_method(replace(config, model=bare), CPU).parts()) == {
        "encoder",
        "skinning",
        "radiance",
    }


def test_window_opens_as_the_schedule_says(config: TrainConfig) -> None:
    octaves = config.actorsnerf.deformation_net.octaves
    assert window_at(config, 0) == 0
    assert window_at(config, config.schedule.steps - 1) == octaves


@pytest.mark.parametrize("name", ["humannerf", "neuralbody"])
def test_every_method_is_built_by_its_configuration(name: MethodName) -> None:
    config = alone(name, "tiny")
    method = build_method(config, CPU)
    assert type(method).__name__.lower() == name
    assert trunk_of(config) is None
    octaves = 3 if name == "humannerf" else 0
    assert window_at(config, config.schedule.steps - 1) == octaves


def test_with_the_category_frozen_its_maps_are_made_once(
    config: TrainConfig, sample: Sample
) -> None:
    method = build_method(config, CPU).train()
    known = know_actor(method, sample.supports)
    assert known.prior is None
    method.freeze_category_prior()
    frozen = know_actor(method, sample.supports)
    assert frozen.prior is not None
    assert not frozen.prior.body.skinning.weights.requires_grad
    state, residual = step_state(method, sample.supports, frozen, 3.0)
    assert state.body is frozen.prior.body
    assert not residual.requires_grad
    assert isinstance(state.maps, UnreadMap)
    assert state.maps.trunk is frozen.prior.trunk
    assert not state.maps.trunk.table.requires_grad and state.maps.weight.requires_grad


def test_residual_is_the_mean_over_voxels_of_the_channels_absolute_sum(
    config: TrainConfig, sample: Sample
) -> None:
    method = actorsnerf(build_method(config, CPU))
    state, residual = step_state(method, sample.supports, know_actor(method, sample.supports), 0.0)
    logits = state.body.residual
    voxels = logits[0].numel()
    assert residual.item() == pytest.approx(logits.abs().double().sum().item() / voxels, rel=1e-5)
    torch.autograd.backward(residual)
    assert any(p.grad is not None for p in method.skinning.parameters())
