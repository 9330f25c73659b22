from dataclasses import replace

import pytest

from actorsnerf_model.humannerf import HumanNeRFConfig
from actorsnerf_model.neuralbody import NeuralBodyConfig
from actorsnerf_train.config import (
    PresetName,
    Rates,
    TrainConfig,
    alone,
    fewshot,
    from_scratch,
    humannerf,
    neuralbody,
    of_person,
    pretraining,
)
from actorsnerf_train.losses import LossWeights
from actorsnerf_train.schedule import count, open_bands

PRESETS: tuple[PresetName, ...] = ("official", "official-short", "small", "small-vgg", "tiny")


def test_official_numbers_are_the_published_ones() -> None:
    config = pretraining("official")
    assert (config.schedule.steps, count(config.schedule, 123)) == (200_000, 123)
    assert (config.losses.perceptual, config.losses.squared_error, config.losses.skinning) == (
        1.0,
        0.2,
        0.01,
    )
    assert (config.patches.count, config.patches.side, config.render.samples) == (4, 32, 128)
    assert config.rates == Rates(5e-4, 5e-5, 5e-5, 5e-4, 5e-4, 1.0)
    few = fewshot("official")
    assert (few.schedule.steps, few.patches.count, few.losses.skinning) == (300_000, 2, 0.0)
    assert [count(few.schedule, step) for step in (0, 300_000)] == [100_000, 400_000]


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_differ_in_sizes_not_in_the_method(preset: PresetName) -> None:
    pre, few = pretraining(preset), fewshot(preset)
    assert pre.model == few.model
    assert (pre.stage, few.stage) == ("pretrain", "fewshot")
    assert (pre.freeze_category, few.freeze_category) == (False, True)
    squared_error = 0.2 if preset == "official" else 3.0
    assert pre.losses == LossWeights(1.0, squared_error, 0.01)
    assert few.losses == LossWeights(1.0, squared_error, 0.0)
    octaves = pre.actorsnerf.deformation_net.octaves
    assert open_bands(pre.schedule, 0, octaves) == 0
    assert open_bands(pre.schedule, pre.schedule.steps // 2, octaves) == octaves
    assert open_bands(few.schedule, 0, octaves) == octaves


def test_short_official_runs_have_the_official_sizes() -> None:
    whole, short = pretraining("official"), pretraining("official-short")
    assert short.render == whole.render
    for part in ("skinning", "deformation_net", "sparse", "views"):
        assert getattr(short.actorsnerf, part) == getattr(whole.actorsnerf, part)
    sizes = [(c.actorsnerf.radiance.width, c.actorsnerf.radiance.code) for c in (whole, short)]
    assert sizes[0] == sizes[1] == (256, 256)


def test_a_step_of_official_is_a_count_from_scratch_too() -> None:
    for config in (pretraining("official"), from_scratch(fewshot("official"))):
        assert config.schedule.last_count - config.schedule.first_count == config.schedule.steps


def test_from_scratch_everything_learns_from_count_zero() -> None:
    config = from_scratch(fewshot("small"))
    assert config.schedule.steps == fewshot("small").schedule.steps
    assert (config.schedule.first_count, config.freeze_category) == (0, False)
    assert config.losses == pretraining("small").losses


def _has_tuned_rates(baseline: TrainConfig, ours: TrainConfig) -> None:
    """All rates of `small` times what tuning found; the same rates elsewhere."""
    scale = 2.0 if ours.preset in ("small", "small-vgg") else 1.0
    assert baseline.rates == replace(ours.rates, scale=scale * ours.rates.scale)


@pytest.mark.parametrize("preset", PRESETS)
def test_the_baseline_learns_on_equal_terms(preset: PresetName) -> None:
    """Same pictures, steps, patches and background; its own networks, mask, scale of rates."""
    baseline, ours = humannerf(preset), from_scratch(fewshot(preset))
    assert (baseline.method, baseline.stage) == ("humannerf", "fewshot")
    assert isinstance(baseline.model, HumanNeRFConfig)
    assert (baseline.render.soft_mask, ours.render.soft_mask) == (True, False)
    assert (baseline.losses.skinning, baseline.freeze_category) == (0.0, False)
    _has_tuned_rates(baseline, ours)
    for name in ("schedule", "patches", "seed", "precision"):
        assert getattr(baseline, name) == getattr(ours, name)
    assert replace(baseline.render, soft_mask=False) == ours.render
    assert replace(baseline.losses, skinning=ours.losses.skinning) == ours.losses


@pytest.mark.parametrize("preset", PRESETS)
def test_neural_body_learns_on_equal_terms(preset: PresetName) -> None:
    """Same pictures, steps, patches, samples and background; its own networks, scale of rates."""
    baseline, ours = neuralbody(preset), from_scratch(fewshot(preset))
    assert (baseline.method, baseline.stage) == ("neuralbody", "fewshot")
    assert isinstance(baseline.model, NeuralBodyConfig)
    assert baseline.model.field.density == ("relu" if preset == "official" else "softplus")
    assert (baseline.losses.skinning, baseline.freeze_category) == (0.0, False)
    _has_tuned_rates(baseline, ours)
    for name in ("schedule", "patches", "seed", "precision", "render"):
        assert getattr(baseline, name) == getattr(ours, name)
    assert replace(baseline.losses, skinning=ours.losses.skinning) == ours.losses


def test_each_method_has_its_fitting_alone() -> None:
    assert alone("actorsnerf", "tiny") == from_scratch(fewshot("tiny"))
    assert alone("humannerf", "tiny") == humannerf("tiny")
    assert alone("neuralbody", "tiny") == neuralbody("tiny")


def test_only_neural_body_depends_on_who_it_is() -> None:
    base = neuralbody("tiny")
    assert isinstance(base.model, NeuralBodyConfig)
    own = replace(base.model, vertices=77, frames=(3, 5))
    assert of_person(base, 77, (3, 5)) == replace(base, model=own)
    for config in (humannerf("tiny"), fewshot("tiny")):
        assert of_person(config, 77, (3, 5)) == config
