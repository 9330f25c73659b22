import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from actorsnerf_train.checkpoint import CheckpointError, load_checkpoint
from actorsnerf_train.config import TrainConfig
from actorsnerf_train.loop import Training
from actorsnerf_train.methods import actorsnerf, build_method
from actorsnerf_train.optimiser import adam
from actorsnerf_train.saving import Learner, load_model, restore, save

CPU = torch.device("cpu")
MakeTraining = Callable[[Path, TrainConfig], Training]


def learner_of(training: Training) -> Learner:
    optimiser = adam(training.method.parts(), training.folder.config.rates)
    return Learner(training.method, optimiser, torch.amp.GradScaler("cpu", enabled=False), ())


def test_there_and_back(make_training: MakeTraining, config: TrainConfig, tmp_path: Path) -> None:
    training = make_training(tmp_path, config)
    learner = learner_of(training)
    assert restore(training.folder, learner, write=True) == (0, 0.0)
    weight = actorsnerf(training.method).radiance.colour_out.weight
    learner.backward(weight.square().sum())
    learner.step()
    torch.manual_seed(77)
    save(training.folder, learner, 4, 2.5)
    expected = torch.rand(3)
    torch.manual_seed(1)
    again = make_training(tmp_path, config)
    other = learner_of(again)
    assert restore(again.folder, other, write=True) == (4, 2.5)
    assert torch.equal(actorsnerf(again.method).radiance.colour_out.weight, weight)
    for one, two in ((learner, training), (other, again)):
        one.backward(actorsnerf(two.method).radiance.colour_out.weight.square().sum())
        one.step()
    assert torch.equal(actorsnerf(again.method).radiance.colour_out.weight, weight)
    torch.manual_seed(77)
    restore(again.folder, other, write=True)
    assert torch.equal(torch.rand(3), expected)


def test_loss_scaling_of_half_precision_comes_back(
    make_training: MakeTraining, config: TrainConfig, tmp_path: Path
) -> None:
    training = make_training(tmp_path, config)
    plain = learner_of(training)
    half = replace(plain, scaler=torch.amp.GradScaler("cpu", init_scale=2.0**20))
    weight = actorsnerf(training.method).radiance.colour_out.weight
    half.backward(weight.sum() * math.inf)  # an overflow: the step is left out, the scale halved
    before = weight.detach().clone()
    half.step()
    assert torch.equal(weight, before)
    save(training.folder, half, 4, 1.0)
    fresh = replace(plain, scaler=torch.amp.GradScaler("cpu", init_scale=2.0**20))
    restore(training.folder, fresh, write=False)
    assert fresh.scaler.get_scale() == half.scaler.get_scale() == 2.0**19


def test_weights_of_another_configuration_are_refused(
    make_training: MakeTraining, config: TrainConfig, category_run: Path
) -> None:
    checkpoint = load_checkpoint(category_run)
    method = build_method(config, CPU)
    load_model(method, checkpoint)
    bare = replace(config, model=replace(config.actorsnerf, deformation=False))
    with pytest.raises(CheckpointError, match=r"another configuration's weights: \d+ entries"):
        load_model(build_method(bare, CPU), checkpoint)
    radiance = replace(config.actorsnerf.radiance, width=12)
    wider = replace(config, model=replace(config.actorsnerf, radiance=radiance))
    with pytest.raises(CheckpointError, match="first radiance"):
        load_model(build_method(wider, CPU), checkpoint)
