"""`bake`: a fitted actor as one file that renders many times a second on a CPU."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.shell import quoted
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked.baking import BakeOptions, bake
from actorsnerf_model.baked.file import SUFFIX, write_baked
from actorsnerf_train.distributed import local_device
from actorsnerf_train.records import to_json
from actorsnerf_train.trained import Baking, TrainedActor, load_trained

FINEST, COARSEST = 0.002, 0.1
"""Metres: voxels outside this are a slip of the keyboard."""


@dataclass(frozen=True)
class BakeCommand:
    """Makes of a fitted actor one file without networks or pictures; no data file is needed.

    `render` and `evaluate` take it as --checkpoint and draw it many times faster on a CPU.
    """

    checkpoint: Path
    """Few-shot run folder, or one of its checkpoints."""
    out: Path
    """File to write, e.g. actor.safetensors."""
    voxel: float = 0.006
    """Distance between nodes of colour and density, metres: 0.006 for people of some 400 pixels'
    height, 0.01 for 200, 0.02 is small and blurred; half the voxel takes four to eight times the
    bytes."""
    offset_spacing: float = 0.04
    """Distance between nodes of the pose-dependent deformation, metres."""
    device: str = "cpu"
    """Where to bake: cpu, cuda, cuda:1, ..."""


def run_bake(options: BakeCommand) -> tuple[str, ...]:
    """What to tell, after the file was written.

    Raises:
        UserError: no such checkpoint, one of a category, or a voxel that makes no sense.
    """
    if options.out.suffix != SUFFIX:
        raise UserError(f"{options.out}: a baked actor is written as {SUFFIX}: change --out.")
    for name, length in (("voxel", options.voxel), ("offset-spacing", options.offset_spacing)):
        if not FINEST <= length <= COARSEST:
            raise UserError(
                f"--{name} {length:g}: is in metres, from {FINEST:g} to {COARSEST:g}; "
                "0.006 is a good voxel, 0.04 a good offset spacing."
            )
    trained = load_trained(options.checkpoint, local_device(options.device))
    baking = bake_to(trained, options)
    report, size = baking.report, options.out.stat().st_size
    program = "python -m actorsnerf_train"
    return (
        f"baked: {options.out} ({size / 1e6:.1f} MB, {report.bricks} bricks of "
        f"{options.voxel * 100:g} cm voxels, {report.offset_nodes} deformation nodes)",
        f"the support poses slide pixel features by {report.slide * 1000:.1f} mm; of the "
        f"deformation beyond its mean {report.follow:.0%} is followed",
        f"next: {program} render --checkpoint {quoted(options.out)} --out FOLDER",
    )


def bake_to(trained: TrainedActor[Any], options: BakeCommand) -> Baking:
    """How the file that was written to `options.out` was made.

    Raises:
        UserError: the method has no baked form.
    """
    method = trained.method
    if not isinstance(method, ActorsNeRF):
        raise UserError(
            f"{trained.path}: was fitted with {trained.info.method}, which has no baked form; "
            "bake a checkpoint of actorsnerf."
        )
    how = BakeOptions(options.voxel, options.offset_spacing, trained.config.render.threshold)
    exact = method.in_precision(torch.float32)
    data, report = bake(exact, trained.state, trained.supports, how)
    baking = Baking(trained.actor, trained.support_count, str(trained.path), how, report)
    record = {
        "checkpoint": json.dumps(to_json(trained.info)),
        "baking": json.dumps(to_json(baking)),
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    write_baked(options.out, data, record)
    return baking


__all__ = ["BakeCommand", "bake_to", "run_bake"]
