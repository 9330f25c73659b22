"""The pictures that the report measures on: true poses, cameras and colours of a prepared file."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_datasets.body_box import body_box, box_mask
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import Float64
from actorsnerf_model.states import ActorState, Camera
from actorsnerf_train.evaluate import EvaluateOptions, plan_evaluation
from actorsnerf_train.trained import TrainedActor


@dataclass(frozen=True)
class Frame:
    """One picture to render and what it should show."""

    name: str
    """Camera and frame number."""
    pose: Float[Tensor, "24 3"]
    rest_joints: Float[Tensor, "24 3"]
    camera: Camera
    truth: Float[Tensor, "height width 3"]
    mask: Bool[Tensor, "height width"]
    """The person's pixels."""
    box: Bool[Tensor, "height width"]
    """Pixels whose ray meets the body's box: the only ones that cost the reference anything."""


@dataclass(frozen=True)
class Health:
    """How well trained the actor is that was measured: times of an empty picture say nothing."""

    alpha_inside: float
    """Mean rendered opacity on the person's pixels."""
    psnr: float
    """Decibel to the true pictures inside the body's box, rendered completely."""


def report_frames(
    trained: TrainedActor[ActorState], file: SequenceFile, frames: int, cameras: int
) -> tuple[Frame, ...]:
    """Evaluation pictures of the actor, evenly spread over frames and cameras.

    Args:
        trained: the fitted actor.
        file: of the same actor.
        frames: how many frame numbers at most.
        cameras: how many cameras at most.

    Raises:
        UserError: another actor's file, or no valid evaluation picture.
    """
    nowhere = Path()
    options = EvaluateOptions(
        trained.path, file.path, nowhere, max_frames=frames, max_cameras=cameras
    )
    plan = plan_evaluation(trained, file, options)
    return tuple(_frame(trained, file, pair) for pair in plan.pairs)


def file_of(actor: str, data: tuple[Path, ...], checkpoint: Path) -> Path:
    """The one of the prepared files that shows an actor.

    Raises:
        UserError: none does, or one is missing or damaged.
    """
    shown: list[str] = []
    for path in data:
        with SequenceFile(path) as file:
            if file.header.actor == actor:
                return path
            shown.append(f"{path.name} shows {file.header.actor}")
    raise UserError(
        f"{checkpoint}: was fitted to {actor}, but {', '.join(shown)}: give --data the prepared "
        "file of that actor."
    )


def resized(frame: Frame, size: tuple[int, int], zoom: float) -> Frame:
    """The frame in a picture of another size, the person `zoom` times as large; no truth any more.

    The person's place in the picture moves with the middle, so that nothing is cut off that was
    not before.
    """
    old = torch.tensor([(side - 1) / 2 for side in frame.camera.size])
    new = torch.tensor([(side - 1) / 2 for side in size])
    K = frame.camera.K.clone()
    K[:2, :2] *= zoom
    K[:2, 2] = (K[:2, 2] - old.to(K)) * zoom + new.to(K)
    return replace(frame, camera=Camera(K, frame.camera.camera_from_body, size))


def _frame(trained: TrainedActor[ActorState], file: SequenceFile, place: tuple[int, int]) -> Frame:
    camera, frame = place
    fits, known, device = file.header.fits, file.header.cameras[camera], trained.device
    camera_from_body = file.camera_from_body(camera, frame)
    pose = np.concatenate([np.zeros((1, 3)), fits.body_pose[frame]])
    box = box_mask(known.size, known.K, camera_from_body, body_box(fits.posed_joints[frame]))
    background = trained.config.render.background
    return Frame(
        f"{known.name}, frame {int(file.header.frames[frame])}",
        _float32(pose, device),
        _float32(fits.rest_joints[frame], device),
        Camera(_float32(known.K, device), _float32(camera_from_body, device), known.size),
        torch.from_numpy(file.full_picture(camera, frame, background)),
        torch.from_numpy(file.full_alpha(camera, frame)) > 0.5,
        torch.from_numpy(box),
    )


def _float32(array: Float64, device: torch.device) -> Tensor:
    return torch.from_numpy(array).to(device, torch.float32)


__all__ = ["Frame", "Health", "file_of", "report_frames", "resized"]
