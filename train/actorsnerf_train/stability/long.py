"""The long run: a bfloat16 training on an invented person without a NaN, as one more judged row."""

import json
from dataclasses import replace
from pathlib import Path

import torch

from actorsnerf_train.checkpoint import DataFile, Origin
from actorsnerf_train.config import Every, TrainConfig
from actorsnerf_train.health import TrainingError
from actorsnerf_train.invented_actor import InventedSource
from actorsnerf_train.journal import LOG
from actorsnerf_train.loop import Training, train
from actorsnerf_train.losses import Perceptual
from actorsnerf_train.methods import build_method
from actorsnerf_train.run_folder import RunFolder
from actorsnerf_train.stability.case import Result, Row

LONG_STEPS = 2000
SIZE = (80, 96)
"""Width and height of the invented pictures."""
NAME = "training in bfloat16"


def long_row(config: TrainConfig, steps: int, folder: Path, device: torch.device) -> Row:
    """A category training of so many steps, judged: every loss a number, and less in the end.

    Args:
        config: whose method, samples and rates are taken; the weights are new.
        steps: how many.
        folder: of the run; an interrupted one is gone on with.
        device: where to compute.
    """
    config = _config(config, steps)
    patches = (config.patches.count, config.patches.side)
    source = InventedSource(config.model.views, patches, SIZE)
    data = (DataFile("invented", "invented", "invented", "0" * 64),)
    origin = Origin(config.actorsnerf.encoder.trunk, False, None, None, ())
    training = Training(
        folder=RunFolder(folder, config, data, None, origin),
        method=build_method(config, device),
        source=source,
        perceptual=Perceptual(None).to(device),
        device=device,
    )
    try:
        train(training)
        note = ""
    except TrainingError as error:
        note = str(error)
    losses = _losses(folder / LOG)
    alive = not note and None not in losses
    first, last = (losses[0], losses[-1]) if losses else (None, None)
    note = note or f"loss {first:.4g} at first, {last:.4g} in the end"
    results = (Result("bfloat16", None, None, alive, None),)
    measured = f"{steps} steps without NaN, collapse or fog"
    return Row("long run", NAME, measured, results, None, alive, 0.0, note)


def not_run(steps: int) -> Row:
    """The row that says that the long run was left out; it neither passes nor fails."""
    measured = f"{steps} steps without NaN, collapse or fog"
    note = "not run: add --long"
    return Row("long run", NAME, measured, (), None, True, 0.0, note)


def _config(config: TrainConfig, steps: int) -> TrainConfig:
    every = Every(log=max(steps // 40, 1), checkpoint=max(steps // 4, 1), picture=0, milestone=0)
    return replace(
        config,
        stage="pretrain",
        schedule=replace(config.schedule, steps=steps, first_count=0),
        freeze_category=False,
        precision="bfloat16",
        perceptual="gradient_pyramid",
        processes=1,
        accumulation=1,
        every=every,
    )


def _losses(log: Path) -> list[float | None]:
    """The logged losses; None for one that is no number."""
    if not log.is_file():
        return []
    lines = log.read_text(encoding="utf-8").splitlines()
    return [json.loads(line)["loss"] for line in lines]


__all__ = ["LONG_STEPS", "long_row", "not_run"]
