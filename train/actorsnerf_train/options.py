"""What both trainings' command lines share: changes to a preset, and how to compute."""

import math
from dataclasses import dataclass, field, replace
from typing import TypeVar

from actorsnerf_model.actorsnerf import ActorsNeRFConfig
from actorsnerf_train.bounds import above, at_least, below
from actorsnerf_train.config import Background, Precision, TrainConfig
from actorsnerf_train.losses import Perceptual
from actorsnerf_train.lpips import INSTALL, LpipsFiles, load_lpips

Value = TypeVar("Value")


@dataclass(frozen=True)
class Resources:
    """How to compute; changes no result but by rounding."""

    device: str = "cpu"
    """cpu, cuda, cuda:1, ...; under torchrun cuda is each process's own."""
    workers: int = 1
    """Processes that load samples ahead; 0 loads them in between."""
    check: bool = True
    """Check the prepared files first (--no-check saves the minutes this takes on big ones)."""
    lpips: LpipsFiles = field(default_factory=LpipsFiles)
    """Your own files with the published LPIPS weights, where `make setup` could not get them."""


@dataclass(frozen=True)
class Changes:
    """What may differ from the preset."""

    steps: int | None = None
    """Length of the run; kick-in, annealing and decay keep their fractions of it."""
    seed: int = 0
    """Of the first weights, the samples and the jitter along rays."""
    rate_scale: float = 1.0
    """All learning rates times this; lower it when a training collapses."""
    samples: int | None = None
    """Per ray."""
    patches: int | None = None
    """Per picture."""
    accumulation: int = 1
    """Pictures per step and process."""
    background: Background | None = None
    """Behind what is learned from: the data set's, or a random one for every picture (fills the
    person sooner)."""
    precision: Precision = "float32"
    """Of products inside networks; bfloat16 is faster on recent processors."""
    checkpoint_every: int | None = None
    """Steps between checkpoints; 0: only at the end."""
    picture_every: int | None = None
    """Steps between sample pictures; 0: only at the end."""


def refuse_nonsense(changes: Changes, use: Resources) -> None:
    """Nothing, if every number can be meant.

    Raises:
        UserError: one cannot.
    """
    at_least(1, changes, "steps", "samples", "patches", "accumulation")
    at_least(0, changes, "seed", "checkpoint_every", "picture_every")
    at_least(0, use, "workers")
    above(0, changes, "rate_scale")
    below(math.inf, changes, "rate_scale")


def changed(config: TrainConfig, changes: Changes) -> TrainConfig:
    """The preset with the changes made."""
    every = replace(
        config.every,
        checkpoint=_or(changes.checkpoint_every, config.every.checkpoint),
        picture=_or(changes.picture_every, config.every.picture),
    )
    return replace(
        config,
        schedule=replace(config.schedule, steps=_or(changes.steps, config.schedule.steps)),
        seed=changes.seed,
        rates=replace(config.rates, scale=config.rates.scale * changes.rate_scale),
        render=replace(config.render, samples=_or(changes.samples, config.render.samples)),
        patches=replace(config.patches, count=_or(changes.patches, config.patches.count)),
        accumulation=changes.accumulation,
        background=_or(changes.background, config.background),
        precision=changes.precision,
        every=every,
    )


def on_ground(config: TrainConfig, colour: tuple[float, float, float]) -> TrainConfig:
    """The configuration with every picture, seen or rendered, on one background colour."""
    model = config.model
    if isinstance(model, ActorsNeRFConfig):
        model = replace(model, encoder=replace(model.encoder, background=colour))
    return replace(config, model=model, render=replace(config.render, background=colour))


def ready_perceptual(files: LpipsFiles) -> Perceptual:
    """LPIPS where its weights are installed or given, else the substitute under its own name."""
    return Perceptual(load_lpips(files))


def perceptual_note(perceptual: Perceptual) -> str:
    """What to tell about the perceptual term."""
    if perceptual.name == "lpips":
        return "perceptual loss: LPIPS (VGG-16, v0.1, published weights)"
    return (
        "LPIPS not computed: its weights are not installed; the perceptual loss is "
        f"{perceptual.name} instead, and results differ. Install them with: {INSTALL}"
    )


def _or(changed: Value | None, preset: Value) -> Value:
    return preset if changed is None else changed
