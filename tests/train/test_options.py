from pathlib import Path

import pytest

from actorsnerf_train import lpips
from actorsnerf_train.config import pretraining
from actorsnerf_train.lpips import LpipsFiles
from actorsnerf_train.options import (
    Changes,
    changed,
    on_ground,
    perceptual_note,
    ready_perceptual,
)


def test_without_changes_a_preset_is_itself() -> None:
    assert changed(pretraining("official"), Changes()) == pretraining("official")


def test_changes_arrive_where_they_belong() -> None:
    changes = Changes(
        steps=100,
        seed=3,
        rate_scale=0.5,
        samples=16,
        patches=5,
        accumulation=2,
        precision="bfloat16",
        checkpoint_every=7,
        picture_every=0,
    )
    config = changed(pretraining("official"), changes)
    assert (config.schedule.steps, config.schedule.last_count) == (100, 200_000)
    assert (config.seed, config.rates.of("encoder")) == (3, 2.5e-4)
    assert (config.render.samples, config.patches.count) == (16, 5)
    assert (config.accumulation, config.precision) == (2, "bfloat16")
    assert (config.every.checkpoint, config.every.picture) == (7, 0)


def test_supports_and_renderings_stand_on_one_ground() -> None:
    config = on_ground(pretraining("tiny"), (1.0, 1.0, 1.0))
    assert config.render.background == (1.0, 1.0, 1.0)
    assert config.actorsnerf.encoder.background == (1.0, 1.0, 1.0)


def test_without_weights_nothing_is_called_lpips(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lpips, "PACKAGE", "no_such_package_is_installed")
    perceptual = ready_perceptual(LpipsFiles())
    assert perceptual.name == "gradient_pyramid"
    note = perceptual_note(perceptual)
    assert note.startswith("LPIPS not computed: its weights are not installed")
    assert "requirements/lpips-weights.txt" in note
    assert Path("requirements/lpips-weights.txt").name in note
