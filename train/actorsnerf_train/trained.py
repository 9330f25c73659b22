"""A fitted actor ready to be rendered: everything comes from one checkpoint or baked file."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_file import supports_from_tensors
from actorsnerf_model.baked.actor import BakedActor, BakedPose, BakedState, baked_state
from actorsnerf_model.baked.baking import BakeOptions, BakeReport
from actorsnerf_model.baked.file import SUFFIX, BakedFileError, read_baked
from actorsnerf_model.baked.render import render_baked
from actorsnerf_model.render import render
from actorsnerf_model.states import (
    ActorState,
    Camera,
    Method,
    PoseState,
    Rendering,
    RenderOptions,
)
from actorsnerf_train.checkpoint import CheckpointError, CheckpointInfo, load_checkpoint
from actorsnerf_train.config import TrainConfig
from actorsnerf_train.methods import build_method, window_at
from actorsnerf_train.records import from_json
from actorsnerf_train.saving import load_model


@dataclass(frozen=True)
class Baking:
    """How a baked actor was made."""

    actor: str
    """Whom it shows."""
    supports: int
    """Support views that the method had."""
    checkpoint: str
    """That it was made of."""
    options: BakeOptions
    report: BakeReport


@dataclass(frozen=True)
class Home:
    """The actor as one of the support views shows it."""

    pose: Float[Tensor, "24 3"]
    rest_joints: Float[Tensor, "24 3"]
    canonical_joints: Float[Tensor, "24 3"]


@dataclass(frozen=True)
class TrainedActor(Generic[ActorState]):
    """A method that was fitted to one actor, or its baked form."""

    method: Method[ActorState]
    state: ActorState
    supports: tuple[View, ...]
    """None left of a baked actor."""
    config: TrainConfig
    info: CheckpointInfo
    path: Path
    """Of the checkpoint or the baked file."""
    baking: Baking | None = None
    """None unless it is baked."""

    @property
    def actor(self) -> str:
        """Whom it shows."""
        return self.supports[0].actor if self.baking is None else self.baking.actor

    @property
    def support_count(self) -> int:
        """K, the support views that its method had."""
        return len(self.supports) if self.baking is None else self.baking.supports

    @property
    def home(self) -> Home:
        """A pose that it was seen in: the first support view's."""
        if isinstance(self.state, BakedState):
            data = self.state.data
            return Home(data.home_pose, data.home_joints, data.canonical_joints)
        first = self.supports[0]
        return Home(first.pose, first.rest_joints, first.canonical_joints)

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return self.home.pose.device


def load_actor(source: Path, device: torch.device) -> TrainedActor[Any]:
    """The actor of a few-shot run folder, of a checkpoint, or of a baked file.

    Raises:
        UserError: there is none, it is damaged, or it is of something else.
    """
    lone = source.suffix == SUFFIX and not source.with_suffix(".json").is_file()
    return load_baked(source, device) if lone else load_trained(source, device)


def load_baked(path: Path, device: torch.device) -> TrainedActor[BakedState]:
    """The actor of a baked file; `config.render` is how to render it.

    Raises:
        BakedFileError: no such file, no baked actor, or one of a newer version.
    """
    file = read_baked(path, device)
    missing = [name for name in ("checkpoint", "baking") if name not in file.record]
    if missing:
        raise BakedFileError(
            f"{path}: does not say where it comes from ({' and '.join(missing)} are missing): bake "
            "it with python -m actorsnerf_train bake"
        )
    info = from_json(CheckpointInfo, json.loads(file.record["checkpoint"]), f"{path}: checkpoint")
    baking = from_json(Baking, json.loads(file.record["baking"]), f"{path}: baking")
    config = from_json(TrainConfig, dict(info.configuration), f"{path}: configuration")
    state = baked_state(file.data)
    return TrainedActor(BakedActor(), state, (), config, info, path, baking)


@torch.no_grad()
def draw(
    trained: TrainedActor[ActorState], pose: PoseState, camera: Camera, options: RenderOptions
) -> Rendering:
    """The picture of an actor in the way that suits it.

    Args:
        trained: the actor.
        pose: of its method's `pose_state`.
        camera: seen from the posed body frame.
        options: how to spend work.
    """
    method, state = trained.method, trained.state
    if isinstance(method, BakedActor) and isinstance(state, BakedState):
        assert isinstance(pose, BakedPose)
        return render_baked(method, state, pose, camera, options)
    return render(method, state, pose, camera, options)


def load_trained(source: Path, device: torch.device) -> TrainedActor[Any]:
    """The actor of a few-shot run folder or checkpoint, in evaluation mode.

    Its state is made once and costs no picture any time, so it is made in float32 however the
    method was trained: one in bfloat16 moved single pixels by 1.3 levels of 255.

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
        exact = method.in_precision(torch.float32)
        state = exact.actor_state(supports, window_at(config, info.step))
    return TrainedActor(method, state, supports, config, info, checkpoint.path)


def with_samples(options: RenderOptions, samples: int | None) -> RenderOptions:
    """The options with another number of samples per ray, where one is given."""
    return options if samples is None else replace(options, samples=samples)


def resampled(trained: TrainedActor[ActorState], samples: int | None) -> TrainedActor[ActorState]:
    """The actor drawn with another number of samples per ray, where one is given."""
    render = with_samples(trained.config.render, samples)
    return replace(trained, config=replace(trained.config, render=render))
