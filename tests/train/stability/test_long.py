from dataclasses import replace
from pathlib import Path

import pytest
import torch

from actorsnerf_train.config import Patches, TrainConfig
from actorsnerf_train.health import HealthLimits
from actorsnerf_train.stability.long import long_row, not_run

CPU = torch.device("cpu")


def test_a_short_long_run(config: TrainConfig, tmp_path: Path) -> None:
    row = long_row(replace(config, patches=Patches(1, 16)), 3, tmp_path / "long", CPU)
    assert row.passed
    assert row.note.startswith("loss 0.")
    assert row.measured == "3 steps without NaN, collapse or fog"
    assert (tmp_path / "long" / "log.jsonl").is_file()


@pytest.mark.slow
def test_a_collapse_is_a_verdict(config: TrainConfig, tmp_path: Path) -> None:
    limits = HealthLimits(window=1, grace=0, least_inside=1.1)
    row = long_row(replace(config, health=limits), 3, tmp_path / "long", CPU)
    assert not row.passed
    assert "the actor has vanished" in row.note


def test_left_out_is_no_verdict() -> None:
    assert not_run(2000).note == "not run: add --long"
    assert not_run(2000).results == ()
