"""A fitted actor ready to be rendered: everything comes from the checkpoint, no data file."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic

import torch

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_file import supports_from_tensors
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.states import ActorState, Method, RenderOptions
from actorsnerf_train.checkpoint import CheckpointError, CheckpointInfo, load_checkpoint
from actorsnerf_train.config import TrainConfig
from actorsnerf_train.methods import build_method, window_at
from actorsnerf_train.records import from_json
from actorsnerf_train.saving import load_model


@dataclass(frozen=True)
class TrainedActor(Generic[ActorState]):
    """A method that was fitted to one actor."""

    method: Method[ActorState]
    state: ActorState
    supports: tuple[View, ...]
    config: TrainConfig
    info: CheckpointInfo
    path: Path
    """Of the checkpoint."""

    @property
    def actor(self) -> str:
        """Whom it shows."""
        return self.supports[0].actor

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return self.supports[0].pose.device


def load_trained(source: Path, device: torch.device) -> TrainedActor[ActorsNeRFState]:
    """The actor of a few-shot run folder or checkpoint, in evaluation mode.

    Raises:
        CheckpointError: there is none, it is damaged, or it is not of a few-shot training.
    """
    checkpoint = load_checkpoint(source)
    info = checkpoint.info
    if info.stage != "fewshot":
        raise CheckpointError(
            f"{checkpoint.path}: is a category checkpoint, which knows no actor; fit it to one "
            "first: python -m actorsnerf_train fewshot --help"
        )
    config = from_json(TrainConfig, dict(info.configuration), f"{checkpoint.path}: configuration")
    method = build_method(config, device)
    load_model(method, checkpoint)
    method.eval()
    supports = supports_from_tensors(checkpoint.part("actor"), device)
    with torch.no_grad():
        state = method.actor_state(supports, window_at(config, info.step))
    return TrainedActor(method, state, supports, config, info, checkpoint.path)


def with_samples(options: RenderOptions, samples: int | None) -> RenderOptions:
    """The options with another number of samples per ray, where one is given."""
    return options if samples is None else replace(options, samples=samples)
