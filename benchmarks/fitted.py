"""The fitted actor of published sizes that some benchmarks measure, and how to name another."""

import argparse
from pathlib import Path
from typing import Any

import torch

from actorsnerf_train.trained import TrainedActor, load_trained, resampled

HERE = Path(__file__).resolve().parent.parent / "data/big"


def add_arguments(parser: argparse.ArgumentParser, samples: int) -> None:
    """Which actor, and its samples per ray unless told otherwise."""
    data = HERE / "prepared/CoreView_heldout00.h5"
    parser.add_argument("--checkpoint", type=Path, default=HERE / "fitted", help="a fitted actor")
    parser.add_argument("--data", type=Path, default=data, help="its prepared file")
    parser.add_argument("--samples", type=int, default=samples, help="per ray")


def fitted_actor(options: argparse.Namespace) -> TrainedActor[Any] | None:
    """The actor that the options name; None, with a word on the screen, if there is none."""
    if not options.checkpoint.exists():
        print(f"not measured: there is no fitted actor at {options.checkpoint}; give --checkpoint")
        return None
    return resampled(load_trained(options.checkpoint, torch.device("cpu")), options.samples)
