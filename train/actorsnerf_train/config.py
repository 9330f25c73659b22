"""What a training is, as one frozen value, and the named presets of both trainings."""

from dataclasses import dataclass, field, replace
from typing import Literal

from actorsnerf_model.actorsnerf import ActorsNeRFConfig
from actorsnerf_model.humannerf import HumanNeRFConfig
from actorsnerf_model.neuralbody import NeuralBodyConfig
from actorsnerf_model.presets import (
    HUMANNERF_OFFICIAL,
    HUMANNERF_OFFICIAL_SHORT,
    HUMANNERF_SMALL,
    HUMANNERF_TINY,
    NEURALBODY_OFFICIAL,
    NEURALBODY_OFFICIAL_SHORT,
    NEURALBODY_SMALL,
    NEURALBODY_TINY,
    OFFICIAL,
    OFFICIAL_SHORT,
    SMALL,
    SMALL_VGG,
    TINY,
)
from actorsnerf_model.states import RenderOptions
from actorsnerf_train.checkpoint import Stage
from actorsnerf_train.health import HealthLimits
from actorsnerf_train.losses import LossWeights
from actorsnerf_train.schedule import Schedule

PresetName = Literal["official", "official-short", "small", "small-vgg", "tiny"]
Precision = Literal["float32", "bfloat16", "float16"]
Background = Literal["fixed", "random"]
MethodName = Literal["actorsnerf", "humannerf", "neuralbody"]
MethodConfig = ActorsNeRFConfig | HumanNeRFConfig | NeuralBodyConfig
FEWSHOT_FIRST_COUNT = 100_000
"""The released code's few-shot fitting begins at this iteration count, the decay included."""


SHORT_RUN_SQUARED_ERROR = 3.0
"""Of short runs: with the paper's 0.2 the perceptual term alone leads, and colours are still those
of no actor after 1,250 steps (measured on synthetic actors)."""


LEAST_LEARNED = 1e-8
"""Share of a pixel below which a training leaves a sample out: nearly half the time of an opaque
actor's step (a tenth more of a hazy one's), and every gradient within 1e-5 of the whole one
(relative L2 in float64, benchmarks/README.md; 1e-7 gives 6e-5 and is some 7 % faster)."""


BASELINE_RATE_SCALE = 2.0
"""Of `small`, times ActorsNeRF's rates: the best for both baselines of those at which they do not
collapse, by LPIPS after 250 steps on an actor of no other run. Neural Body was a little better at 4
there, but collapsed on an actor of the study (benchmarks/results/tuning.md)."""


@dataclass(frozen=True)
class Rates:
    """Adam's base rate of each part (paper, section 4.1; released code)."""

    encoder: float = 5e-4
    skinning: float = 5e-5
    deformation: float = 5e-5
    sparse: float = 5e-4
    radiance: float = 5e-4
    scale: float = 1.0
    """All of them times this."""
    refiner: float = 5e-5
    """HumanNeRF's pose refiner (its released code)."""
    codes: float = 5e-4
    """Neural Body's codes of vertices and frames (its released code)."""

    def of(self, part: str) -> float:
        """The base rate of a part, scaled.

        >>> Rates(scale=0.5).of("skinning")
        2.5e-05
        """
        base: float = getattr(self, part)
        return base * self.scale


@dataclass(frozen=True)
class Patches:
    """How much of a picture one sample looks at."""

    count: int = 4
    """Released code: 4 in category training, 2 in few-shot fitting."""
    side: int = 32
    """Pixels (paper, section 4.1)."""


@dataclass(frozen=True)
class Every:
    """How often something is written, in steps."""

    log: int = 50
    checkpoint: int = 2000
    picture: int = 5000
    milestone: int = 50_000
    """Checkpoints of these steps are kept for good; of the others the newest two. 0 = none."""


@dataclass(frozen=True)
class TrainConfig:
    """Everything that decides what a training computes; equal values give equal weights."""

    stage: Stage
    preset: PresetName
    schedule: Schedule
    method: MethodName = "actorsnerf"
    model: MethodConfig = field(default_factory=ActorsNeRFConfig)
    render: RenderOptions = field(default_factory=RenderOptions)
    freeze_category: bool = False
    """Encoder and skinning stand still, computed once (few-shot fitting; paper, section 4.1)."""
    rates: Rates = field(default_factory=Rates)
    losses: LossWeights = field(default_factory=LossWeights)
    perceptual: Literal["lpips", "gradient_pyramid"] = "lpips"
    """What the perceptual term is; the substitute only where LPIPS weights are missing."""
    patches: Patches = field(default_factory=Patches)
    accumulation: int = 1
    """Samples of each process in a step."""
    processes: int = 1
    precision: Precision = "float32"
    """Of products inside networks; geometry and LPIPS are always float32."""
    background: Background = "fixed"
    """Behind what is learned from: the data set's colour, or a random one for each sample, so that
    a person must be opaque to be right (HumanNeRF's released code). Supports and evaluation stay
    on the data set's."""
    seed: int = 0
    every: Every = field(default_factory=Every)
    health: HealthLimits = field(default_factory=HealthLimits)

    @property
    def actorsnerf(self) -> ActorsNeRFConfig:
        """The model's configuration, which must be of ActorsNeRF."""
        assert isinstance(self.model, ActorsNeRFConfig), self.method
        return self.model


def pretraining(preset: PresetName) -> TrainConfig:
    """The category-level training of a preset."""
    match preset:
        case "official":
            return TrainConfig(
                "pretrain",
                preset,
                Schedule(200_000),
                model=OFFICIAL,
                render=RenderOptions(least_learned=LEAST_LEARNED),
            )
        case "official-short":
            return replace(
                pretraining("small"),
                preset=preset,
                model=OFFICIAL_SHORT,
                render=RenderOptions(least_learned=LEAST_LEARNED),
                rates=Rates(deformation=2e-4, scale=2.0),  # `small`'s volume takes ten times more
            )
        case "small" | "small-vgg":
            return TrainConfig(
                "pretrain",
                preset,
                Schedule(2000, last_count=400_000),
                model=SMALL if preset == "small" else SMALL_VGG,
                render=RenderOptions(samples=64, least_learned=LEAST_LEARNED),
                rates=Rates(deformation=2e-4, skinning=5e-4, scale=2.0),
                losses=LossWeights(squared_error=SHORT_RUN_SQUARED_ERROR),
                patches=Patches(count=2),
                every=Every(log=20, checkpoint=500, picture=500, milestone=0),
            )
        case "tiny":
            return TrainConfig(
                "pretrain",
                preset,
                Schedule(300, last_count=400_000),
                model=TINY,
                render=RenderOptions(samples=32, least_learned=LEAST_LEARNED),
                rates=Rates(deformation=1e-3, skinning=2e-3, scale=4.0),
                patches=Patches(count=2),
                losses=LossWeights(squared_error=SHORT_RUN_SQUARED_ERROR),
                every=Every(log=10, checkpoint=100, picture=150, milestone=0),
            )


def fewshot(preset: PresetName) -> TrainConfig:
    """The few-shot fitting of a preset; counts go on from 100,000 as in the released code."""
    whole = pretraining(preset)
    base = replace(
        whole,
        stage="fewshot",
        freeze_category=True,
        losses=replace(whole.losses, skinning=0.0),
    )
    match preset:
        case "official":
            steps, patches = 300_000, Patches(count=2)
        case "official-short" | "small" | "small-vgg":
            steps, patches = 500, Patches(count=2)
        case "tiny":
            steps, patches = 200, Patches(count=2)
    schedule = Schedule(steps, FEWSHOT_FIRST_COUNT, 400_000)
    return replace(base, schedule=schedule, patches=patches)


def humannerf(preset: PresetName) -> TrainConfig:
    """The fitting of HumanNeRF to one actor's pictures; it has no category to begin from.

    As ActorsNeRF from scratch with the same preset, but for the networks, the soft mask and the
    regulariser, which HumanNeRF lacks. Its released code also draws a random background for every
    picture; in short runs that costs it quality (benchmarks/results/tuning.md), so here all methods
    learn on the data set's.
    """
    base = from_scratch(fewshot(preset))
    match preset:
        case "official":
            model = HUMANNERF_OFFICIAL
        case "official-short":
            model = HUMANNERF_OFFICIAL_SHORT
        case "small" | "small-vgg":
            model = HUMANNERF_SMALL
        case "tiny":
            model = HUMANNERF_TINY
    return replace(
        base,
        method="humannerf",
        model=model,
        rates=_tuned(base),
        render=replace(base.render, soft_mask=True),
        losses=replace(base.losses, skinning=0.0),
    )


def neuralbody(preset: PresetName) -> TrainConfig:
    """The fitting of Neural Body to one actor's pictures; it has no category to begin from.

    As ActorsNeRF from scratch with the same preset, but for the networks and the regulariser, which
    Neural Body lacks. Its released code minimises the squared error of single pixels alone, with 64
    samples a ray in a tighter box; here all methods learn from the same patches with the same
    losses, and their samples lie equally close.
    """
    base = from_scratch(fewshot(preset))
    match preset:
        case "official":
            model = NEURALBODY_OFFICIAL
        case "official-short":
            model = NEURALBODY_OFFICIAL_SHORT
        case "small" | "small-vgg":
            model = NEURALBODY_SMALL
        case "tiny":
            model = NEURALBODY_TINY
    losses = replace(base.losses, skinning=0.0)
    rates = _tuned(base)
    return replace(base, method="neuralbody", model=model, losses=losses, rates=rates)


def _tuned(config: TrainConfig) -> Rates:
    """The rates of a baseline; other presets than `small` were not tuned."""
    tuned = config.preset in ("small", "small-vgg")
    scale = config.rates.scale * (BASELINE_RATE_SCALE if tuned else 1.0)
    return replace(config.rates, scale=scale)


def alone(method: MethodName, preset: PresetName) -> TrainConfig:
    """The fitting of one actor by a method that begins from random weights."""
    match method:
        case "actorsnerf":
            return from_scratch(fewshot(preset))
        case "humannerf":
            return humannerf(preset)
        case "neuralbody":
            return neuralbody(preset)


def of_person(config: TrainConfig, vertices: int, frames: tuple[int, ...]) -> TrainConfig:
    """The configuration for one person, where the model's sizes depend on who it is.

    Args:
        config: of a method.
        vertices: of the person's body.
        frames: numbers of those that are learned from.
    """
    model = config.model
    if isinstance(model, NeuralBodyConfig):
        model = replace(model, vertices=vertices, frames=frames)
    return replace(config, model=model)


def from_scratch(config: TrainConfig) -> TrainConfig:
    """A few-shot fitting without category training: every part learns, counts begin at 0.

    What category training is compared with, at equal steps.
    """
    steps, last = config.schedule.steps, config.schedule.last_count
    if config.preset == "official":  # counts are steps
        last = steps
    schedule = Schedule(steps, 0, last)
    losses = pretraining(config.preset).losses
    return replace(config, freeze_category=False, losses=losses, schedule=schedule)
