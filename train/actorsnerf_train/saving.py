"""What learns, and its way to a checkpoint and back."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_file import support_tensors
from actorsnerf_train.checkpoint import (
    FORMAT,
    FORMAT_VERSION,
    Checkpoint,
    CheckpointError,
    CheckpointInfo,
    optimiser_tensors,
    prune_checkpoints,
    restore_optimiser,
    save_checkpoint,
)
from actorsnerf_train.machine import program_commit
from actorsnerf_train.methods import AnyMethod
from actorsnerf_train.records import to_json_object
from actorsnerf_train.run_folder import RunFolder, package_versions

KEPT = 2
"""Checkpoints kept beside the milestones: the newest may be the one that a crash spoiled."""


@dataclass(frozen=True)
class Learner:
    """A method with its optimiser."""

    method: AnyMethod
    optimiser: torch.optim.Optimizer
    scaler: torch.amp.GradScaler
    """Does nothing but in float16."""
    supports: tuple[View, ...]
    """Of the one actor of a few-shot fitting, which go into its checkpoints; else empty."""

    def backward(self, loss: Tensor) -> None:
        """Add the loss's gradients."""
        torch.autograd.backward(self.scaler.scale(loss))

    def step(self) -> None:
        """Follow the gradients, and forget them."""
        self.scaler.step(self.optimiser)
        self.scaler.update()
        self.optimiser.zero_grad(set_to_none=True)

    def parameters(self) -> dict[str, nn.Parameter]:
        """The method's parameters by name."""
        return dict(self.method.named_parameters())


def save(folder: RunFolder, learner: Learner, step: int, seconds: float) -> Path:
    """The JSON file of a new checkpoint; older ones go, but for milestones."""
    info = checkpoint_info(folder, learner, step, seconds)
    tensors = {f"model/{name}": value for name, value in learner.method.state_dict().items()}
    memory = optimiser_tensors(learner.optimiser, learner.parameters())
    tensors |= {f"optimiser/{name}": value for name, value in memory.items()}
    if learner.supports:
        views = support_tensors(learner.supports)
        tensors |= {f"actor/{name}": value for name, value in views.items()}
    path = save_checkpoint(folder.path, info, tensors)
    prune_checkpoints(folder.path, KEPT, folder.config.every.milestone)
    return path


def checkpoint_info(
    folder: RunFolder, learner: Learner, step: int, seconds: float
) -> CheckpointInfo:
    """What a checkpoint after a step says of itself; its digest is filled in when it is written."""
    return CheckpointInfo(
        format=FORMAT,
        format_version=FORMAT_VERSION,
        stage=folder.config.stage,
        method=folder.config.method,
        step=step,
        seconds=seconds,
        configuration=to_json_object(folder.config),
        origin=folder.origin,
        data=folder.data,
        setting=folder.setting,
        generator=bytes(torch.get_rng_state().tolist()).hex(),
        loss_scale=learner.scaler.state_dict(),
        versions=package_versions(),
        commit=program_commit(),
        tensors_sha256="",
    )


def restore(folder: RunFolder, learner: Learner, write: bool) -> tuple[int, float]:
    """The step to go on with and the seconds trained so far, after the learner was filled.

    Args:
        folder: of the run; a new one is begun if it is empty.
        learner: keeps its weights where the run is new.
        write: whether this process writes `config.json`.

    Raises:
        UserError: the folder holds another run, or its checkpoint is damaged.
    """
    checkpoint = folder.open(write)
    if checkpoint is None:
        return 0, 0.0
    load_model(learner.method, checkpoint)
    restore_optimiser(learner.optimiser, learner.parameters(), checkpoint.part("optimiser"))
    if checkpoint.info.loss_scale:
        learner.scaler.load_state_dict(dict(checkpoint.info.loss_scale))
    state = bytearray.fromhex(checkpoint.info.generator)
    torch.set_rng_state(torch.tensor(list(state), dtype=torch.uint8))
    return checkpoint.info.step, checkpoint.info.seconds


def load_model(method: AnyMethod, checkpoint: Checkpoint) -> None:
    """Fill a method with a checkpoint's weights.

    Raises:
        CheckpointError: they are of another configuration.
    """
    stored, own = checkpoint.part("model"), method.state_dict()
    odd = sorted(stored.keys() ^ own.keys())
    odd = odd or [name for name in own if own[name].shape != stored[name].shape]
    if odd:
        raise CheckpointError(
            f"{checkpoint.path}: holds another configuration's weights: {len(odd)} entries do not "
            f"fit, first {odd[0]}; build the model with the checkpoint's own configuration."
        )
    method.load_state_dict(stored)
