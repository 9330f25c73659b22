from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch.overrides import TorchFunctionMode

from actorsnerf_datasets.torch_dataset import Sample
from actorsnerf_model import actorsnerf as actorsnerf_module
from actorsnerf_train.batches import at_pixels, jitter_generator, on_background
from actorsnerf_train.config import TrainConfig
from actorsnerf_train.loop import Training
from actorsnerf_train.losses import LossWeights
from actorsnerf_train.methods import KnownActor, actorsnerf, know_actor
from actorsnerf_train.objective import Objective, Outcome

CPU = torch.device("cpu")
WAITING = {
    *("item", "tolist", "cpu", "numpy", "new_tensor", "bincount", "is_nonzero", "equal"),
    *("__bool__", "__int__", "__float__", "__index__", "linalg_inv"),
}
"""What makes the host wait for a GPU, but for the choice of ragged samples (`nonzero`)."""


class Waits(TorchFunctionMode):
    """Notes the calls that would make the host wait."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def __torch_function__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        name = getattr(func, "__name__", "")
        if name in WAITING:
            self.found.append(name)
        return func(*args, **(kwargs or {}))


@pytest.fixture
def training(
    make_training: Callable[[Path, TrainConfig], Training], config: TrainConfig, tmp_path: Path
) -> Training:
    return make_training(tmp_path, config)


@pytest.fixture
def sample(training: Training) -> Sample:
    return training.source[0]


@pytest.fixture
def known(training: Training, sample: Sample) -> KnownActor:
    return know_actor(training.method, sample.supports)


def outcome_of(training: Training, sample: Sample, known: KnownActor, window: float) -> Outcome:
    config = training.folder.config
    objective = Objective(training.method, training.perceptual, config.losses, config.render)
    outcome: Outcome = objective(sample, known, window, jitter_generator(0, 0, CPU))
    return outcome


def of_no_density(training: Training) -> Objective:
    """The squared error of an actor that cannot be seen."""
    method = actorsnerf(training.method)
    with torch.no_grad():
        method.radiance.density_out.weight.zero_()
        method.radiance.density_out.bias.fill_(-1e4)
    options = training.folder.config.render
    return Objective(method, training.perceptual, LossWeights(0.0, 1.0, 0.0), options)


def test_every_part_that_is_used_gets_a_gradient(
    training: Training, sample: Sample, known: KnownActor
) -> None:
    torch.autograd.backward(outcome_of(training, sample, known, 3.0).losses.total)
    for name, parameter in training.method.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.isfinite().all(), name


def test_before_its_kick_in_the_deformation_gets_none(
    training: Training, sample: Sample, known: KnownActor
) -> None:
    torch.autograd.backward(outcome_of(training, sample, known, 0.0).losses.total)
    grads = {n: p.grad for n, p in training.method.named_parameters()}
    assert all(grads[name] is None for name in grads if name.startswith("deformation"))
    assert (
        grads["skinning.logits" if "skinning.logits" in grads else "encoder.reduction.bias"]
        is not None
    )


def test_same_jitter_same_loss(training: Training, sample: Sample, known: KnownActor) -> None:
    one = outcome_of(training, sample, known, 3.0)
    two = outcome_of(training, sample, known, 3.0)
    assert torch.equal(one.losses.total, two.losses.total)


@pytest.mark.parametrize("frozen", [False, True])
def test_a_step_on_a_gpu_waits_for_nothing_but_the_count_of_samples(
    training: Training, sample: Sample, frozen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if frozen:
        training.method.freeze_category_prior()
    known = know_actor(training.method, sample.supports)
    with_cells = outcome_of(training, sample, known, 3.0)

    def as_on_a_gpu(device: torch.device) -> bool:
        return torch.is_grad_enabled()

    monkeypatch.setattr(actorsnerf_module, "asks_every_sample", as_on_a_gpu)
    waits = Waits()
    with waits:
        outcome = outcome_of(training, sample, known, 3.0)
    assert waits.found == []
    assert outcome.counts.survivors == with_cells.counts.survivors
    torch.testing.assert_close(outcome.losses.total, with_cells.losses.total)


def test_opacity_is_told_on_and_beside_the_person(
    training: Training, sample: Sample, known: KnownActor
) -> None:
    """With the alpha picture turned inside out the two change places."""
    plain = outcome_of(training, sample, known, 0.0)
    target = replace(sample.target, alpha=1 - sample.target.alpha)
    turned = outcome_of(training, replace(sample, target=target), known, 0.0)
    torch.testing.assert_close(plain.inside, turned.outside)
    torch.testing.assert_close(plain.outside, turned.inside)
    assert plain.counts.survivors <= plain.counts.samples
    assert plain.counts.rays > 0


def test_an_actor_of_no_density_costs_the_pictures_square(
    training: Training, sample: Sample, known: KnownActor
) -> None:
    objective = of_no_density(training)
    outcome: Outcome = objective(sample, known, 0.0, jitter_generator(0, 0, CPU))
    truth = at_pixels(on_background(sample.target, (0.0, 0.0, 0.0)), sample.patches)
    assert outcome.losses.total.item() == pytest.approx(truth.square().mean().item(), rel=1e-5)
    assert outcome.inside.item() == 0


def test_a_background_lies_behind_the_person_in_both_pictures(
    training: Training, sample: Sample, known: KnownActor
) -> None:
    """An actor of no density is right beside the person, whatever the colour, and wrong on it."""
    objective = of_no_density(training)
    red = (0.9, 0.1, 0.2)
    outcome: Outcome = objective(sample, known, 0.0, jitter_generator(0, 0, CPU), red)
    alpha = at_pixels(sample.target.alpha, sample.patches)[..., None]
    person = alpha * (at_pixels(sample.target.image, sample.patches) - torch.tensor(red))
    assert person.square().mean() > 1e-3
    assert outcome.losses.total.item() == pytest.approx(person.square().mean().item(), rel=1e-5)


def test_patches_that_show_nothing_still_have_a_gradient(
    training: Training, sample: Sample, known: KnownActor
) -> None:
    """Frozen skinning and rays beside the body: the loss is a constant, yet a step can go on."""
    training.method.freeze_category_prior()
    config = training.folder.config
    perceptual, losses = training.perceptual, replace(config.losses, skinning=0.0)
    objective = Objective(training.method, perceptual, losses, config.render)
    corner = replace(sample, patches=sample.patches * 0)
    outcome: Outcome = objective(corner, known, 3.0, jitter_generator(0, 0, CPU))
    assert outcome.counts.survivors == 0
    torch.autograd.backward(outcome.losses.total)
    grads = [p.grad for p in training.method.parameters() if p.grad is not None]
    assert grads
    assert all(not grad.any() for grad in grads)
