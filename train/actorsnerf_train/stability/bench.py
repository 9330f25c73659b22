"""Whom the hard cases are tried on: a checkpoint's or an invented actor, in three precisions."""

import copy
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.torch_dataset import View, pad_views, view_at
from actorsnerf_datasets.types import SequenceHeader
from actorsnerf_model.actor_file import supports_from_tensors
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_train.batches import view_to
from actorsnerf_train.checkpoint import Checkpoint, load_checkpoint
from actorsnerf_train.config import PresetName, TrainConfig, pretraining
from actorsnerf_train.invented_actor import invented_views
from actorsnerf_train.methods import actorsnerf, build_method
from actorsnerf_train.records import from_json
from actorsnerf_train.saving import load_model
from actorsnerf_train.stability.case import PRECISIONS, Precision, Subject
from actorsnerf_train.stability.hard_poses import dance_poses, fastest

FASTEST = 3
"""How many of the fastest frames are tried."""
INVENTED_SIZE = (64, 80)
"""Width and height of the invented support pictures."""
AWAKE = 0.5
"""Deviation of the skinning logits of a method without training: away from the plain prior."""
AWAKE_OFFSET = 0.05
"""Deviation of the last deformation weights of such a method: it moves points by centimetres."""


@dataclass(frozen=True)
class Bench:
    """What the cases need."""

    subjects: tuple[Subject, ...]
    """float64, float32, bfloat16."""
    config: TrainConfig
    header: SequenceHeader | None
    """Of the prepared file, if there is one."""
    title: str
    """What was tried, in words."""


def make_bench(
    run: Path | None, data: Path | None, preset: PresetName, device: torch.device
) -> Bench:
    """The three subjects.

    Args:
        run: few-shot or category run folder or checkpoint; None for a method without training.
        data: prepared file: the fastest frames are taken from it and, where the checkpoint has no
            actor of its own, the support views; None for the invented actor.
        preset: of a method without training.
        device: where to compute.

    Raises:
        UserError: no such run or file, or the file has too few pictures for K support views.
    """
    checkpoint = None if run is None else load_checkpoint(run)
    config = pretraining(preset) if checkpoint is None else _config(checkpoint)
    if config.method != "actorsnerf":
        raise UserError(f"{run}: is of {config.method}; the hard cases are for actorsnerf.")
    method = actorsnerf(build_method(config, device))
    if checkpoint is None:
        _awaken(method)
    else:
        load_model(method, checkpoint)
    method.eval()
    header, supports = None, None
    if data is not None:
        with SequenceFile(data) as file:
            header = file.header
            supports = _supports_of(file, config.model.views)
    if checkpoint is not None and checkpoint.info.stage == "fewshot":
        supports = supports_from_tensors(checkpoint.part("actor"), device)
    whose = "an invented actor"
    if supports is None:
        supports = invented_views(config.model.views, INVENTED_SIZE)
    else:
        whose = f"actor {supports[0].actor}"
    supports = tuple(view_to(view, device) for view in supports)
    poses = _poses(header)
    subjects = tuple(_subject(name, method, config, supports, poses) for name in PRECISIONS)
    what = f"an untrained {preset} method" if run is None else f"the checkpoint {run}"
    frames = "" if data is None else f", the fastest frames of {data.name}"
    return Bench(subjects, config, header, f"{what} on {whose}{frames}")


def view_as(view: View, dtype: torch.dtype) -> View:
    """The view with its numbers in another precision."""
    return replace(
        view,
        image=view.image.to(dtype),
        alpha=view.alpha.to(dtype),
        K=view.K.to(dtype),
        camera_from_body=view.camera_from_body.to(dtype),
        pose=view.pose.to(dtype),
        rest_joints=view.rest_joints.to(dtype),
        rest_vertices=view.rest_vertices.to(dtype),
        posed_vertices=view.posed_vertices.to(dtype),
        canonical_joints=view.canonical_joints.to(dtype),
    )


def _config(checkpoint: Checkpoint) -> TrainConfig:
    where = f"{checkpoint.path}: configuration"
    return from_json(TrainConfig, dict(checkpoint.info.configuration), where)


def _subject(
    precision: Precision,
    method: ActorsNeRF,
    config: TrainConfig,
    supports: tuple[View, ...],
    poses: Float[Tensor, "poses 24 3"],
) -> Subject:
    dtype = torch.float64 if precision == "float64" else torch.float32
    own = copy.deepcopy(method).to(dtype)
    own.network_dtype = torch.bfloat16 if precision == "bfloat16" else torch.float32
    views = tuple(view_as(view, dtype) for view in supports)
    window = float(config.actorsnerf.deformation_net.octaves)
    with torch.no_grad():
        state = own.actor_state(views, window)
    options = replace(config.render, stop_transmittance=0.0, least_learned=0.0)
    return Subject(precision, own, views, state, options, poses.float().to(views[0].pose))


@torch.no_grad()
def _awaken(method: ActorsNeRF) -> None:
    """Move what starts at nothing away from it, so that errors have something to show on."""
    generator = torch.Generator().manual_seed(0)
    weights: list[tuple[Tensor, float]] = []
    if method.deformation is not None:
        weights.append((method.deformation.offset.weight, AWAKE_OFFSET))
    logits = getattr(method.skinning, "logits", None)
    if isinstance(logits, nn.Parameter):
        weights.append((logits, AWAKE))
    for weight, size in weights:
        drawn = torch.randn(weight.shape, generator=generator)
        weight.copy_(size * drawn.to(weight))


def _poses(header: SequenceHeader | None) -> Float[Tensor, "poses 24 3"]:
    if header is None or len(header.frames) < 2:
        wild = dance_poses(10 * FASTEST, torch.Generator().manual_seed(1))
        return wild[wild.norm(dim=-1).sum(-1).argsort(descending=True)[:FASTEST]]
    body = torch.from_numpy(header.fits.body_pose)
    poses = torch.cat([torch.zeros_like(body[:, :1]), body], 1)
    return poses[fastest(poses, FASTEST)]


def _supports_of(file: SequenceFile, count: int) -> tuple[View, ...]:
    """Views of the first camera that has enough pictures, spread over the frames."""
    for camera in range(len(file.header.cameras)):
        frames = file.valid[camera].nonzero()[0]
        if len(frames) >= count:
            chosen = [frames[i * (len(frames) - 1) // max(count - 1, 1)] for i in range(count)]
            numbers = [int(file.header.frames[f]) for f in chosen]
            return pad_views([view_at(file, camera, number) for number in numbers])
    raise UserError(
        f"{file.path}: no camera has {count} pictures, which the model needs as support views: "
        "prepare more frames"
    )


__all__ = ["Bench", "make_bench", "view_as"]
