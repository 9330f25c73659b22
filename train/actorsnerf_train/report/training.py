"""A training step's time against the reference's, and whether both give the same gradients."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from actorsnerf_datasets.selection import FewshotChoice
from actorsnerf_datasets.torch_dataset import FewshotDataset, Sample
from actorsnerf_train.batches import jitter_generator, sample_to
from actorsnerf_train.checkpoint import Stage, load_checkpoint
from actorsnerf_train.config import TrainConfig, fewshot, pretraining
from actorsnerf_train.losses import Perceptual
from actorsnerf_train.methods import KnownActor, build_method, know_actor, octaves_of
from actorsnerf_train.objective import Objective
from actorsnerf_train.report.measure import now, settled, spread
from actorsnerf_train.report.reference_step import reference_step
from actorsnerf_train.report.rows import TrainingRow
from actorsnerf_train.saving import load_model
from actorsnerf_train.trained import TrainedActor

STAGES: tuple[Stage, ...] = ("pretrain", "fewshot")


@dataclass(frozen=True)
class Step:
    """A training step that can be repeated; neither way of taking it changes the weights."""

    stage: Stage
    objective: Objective
    sample: Sample
    known: KnownActor
    window: float
    seed: int
    samples_per_ray: int

    def ours(self) -> float:
        """The loss, after the trainings' own forward and backward pass."""
        self.objective.zero_grad(set_to_none=True)
        device = self.sample.patches.device
        jitter = jitter_generator(self.seed, 0, device)
        outcome = self.objective(self.sample, self.known, self.window, jitter)
        torch.autograd.backward(outcome.losses.total)
        return float(outcome.losses.total.detach())

    def reference(self) -> float:
        """The loss, after the reference's forward and backward pass."""
        self.objective.zero_grad(set_to_none=True)
        jitter = jitter_generator(self.seed, 0, self.sample.patches.device)
        return reference_step(self.objective, self.sample, self.known, self.window, jitter)

    def gradients(self) -> dict[str, Tensor]:
        """By parameter name, those of the last pass."""
        named = self.objective.method.named_parameters()
        return {name: p.grad.clone() for name, p in named if p.grad is not None}


def make_step(
    stage: Stage, trained: TrainedActor[Any], data: Path, perceptual: Perceptual, seed: int
) -> Step:
    """A step of a stage on the fitted actor: its weights, its supports, patches of its frames.

    Args:
        stage: which parts learn, and the preset's patches.
        trained: of whom weights, supports and samples per ray are taken.
        data: its prepared file.
        perceptual: the distance that both ways minimise.
        seed: of patches and jitter.

    Raises:
        UserError: the file lacks the frames of the fitting.
    """
    config = _config(stage, trained)
    method = build_method(config, trained.device)
    load_model(method, load_checkpoint(trained.path))
    method.train()
    if config.freeze_category:
        method.freeze_category_prior()
    setting = trained.info.setting
    choice = (
        FewshotChoice()
        if setting is None
        else FewshotChoice(setting.name, setting.list_name, setting.protocol, len(trained.supports))
    )
    patches = config.patches
    source = FewshotDataset(data, choice, seed, patches.count, patches.side, 1)
    drawn = sample_to(source[0], trained.device)
    sample = replace(drawn, supports=trained.supports)
    return Step(
        stage,
        Objective(method, perceptual, config.losses, config.render),
        sample,
        know_actor(method, trained.supports),
        float(octaves_of(config)),
        seed,
        config.render.samples,
    )


def training_rows(
    trained: TrainedActor[Any], data: Path, perceptual: Perceptual, rounds: int, seed: int
) -> tuple[TrainingRow, ...]:
    """Both stages, ours and the reference in turns after a warm-up that is compared."""
    return tuple(
        training_row(make_step(stage, trained, data, perceptual, seed), rounds) for stage in STAGES
    )


def training_row(step: Step, rounds: int) -> TrainingRow:
    """One stage measured."""
    device = step.sample.patches.device
    truth = step.reference()
    expected = step.gradients()
    loss = step.ours()
    worst, error = largest_error(step.gradients(), expected)
    ours: list[float] = []
    slow: list[float] = []
    for _ in range(rounds):
        for way, times in ((step.ours, ours), (step.reference, slow)):
            times.append(settled(functools.partial(_seconds, way, device)))
    count, side = step.sample.patches.shape[:2]
    return TrainingRow(
        step.stage,
        count,
        side,
        step.samples_per_ray,
        spread(ours),
        spread(slow),
        spread(slow).median / spread(ours).median,
        abs(loss - truth) / max(abs(truth), 1e-12),
        error,
        worst,
    )


def _seconds(way: Callable[[], float], device: torch.device) -> float:
    began = now(device)
    way()
    return now(device) - began


def largest_error(found: dict[str, Tensor], expected: dict[str, Tensor]) -> tuple[str, float]:
    """The parameter with the largest relative L2 error of its gradient, and that error.

    A gradient that only one of both has counts as wholly wrong, unless it is zero.
    """
    worst, error = "", 0.0
    for name in sorted(found.keys() | expected.keys()):
        one, other = found.get(name), expected.get(name)
        known = other if other is not None else one
        assert known is not None
        zero = torch.zeros_like(known)
        difference = (zero if one is None else one) - (zero if other is None else other)
        size, norm = float(difference.norm()), float((zero if other is None else other).norm())
        relative = size / norm if norm > 0 else float(size > 0)
        if relative >= error:
            worst, error = name, relative
    return worst, error


def _config(stage: Stage, trained: TrainedActor[Any]) -> TrainConfig:
    """A few-shot step as the actor was fitted; a category step as the preset has it."""
    if stage == trained.config.stage:
        return replace(trained.config, precision="float32")
    preset = pretraining if stage == "pretrain" else fewshot
    base = preset(trained.config.preset)
    return replace(
        trained.config,
        stage=stage,
        freeze_category=base.freeze_category,
        losses=base.losses,
        patches=base.patches,
        precision="float32",
    )


__all__ = ["STAGES", "Step", "largest_error", "make_step", "training_row", "training_rows"]
