"""One picture rendered in its true pose, from its true camera, and compared with the truth."""

import time
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.body_box import body_box, box_mask
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_model.states import ActorState, Camera, RenderOptions
from actorsnerf_train.metrics import ConventionName, Lpips, Scores, compare
from actorsnerf_train.pictures import error_picture, to_bytes
from actorsnerf_train.trained import TrainedActor, draw


@dataclass(frozen=True)
class Judgement:
    """How a picture is judged."""

    conventions: tuple[ConventionName, ...]
    render: RenderOptions
    lpips: Lpips | None


@dataclass(frozen=True)
class Judged:
    """One picture: what it should be, what it is, and how near that is."""

    truth: Float[Tensor, "height width 3"]
    prediction: Float[Tensor, "height width 3"]
    scores: dict[ConventionName, Scores]
    seconds: float
    """Rendering alone."""


@torch.no_grad()
def judge(
    trained: TrainedActor[ActorState],
    file: SequenceFile,
    place: tuple[int, int],
    judgement: Judgement,
) -> Judged:
    """One picture, (camera, frame) positions, rendered in its true pose and compared."""
    camera, frame = place
    fits, known, device = file.header.fits, file.header.cameras[camera], trained.device
    camera_from_body = file.camera_from_body(camera, frame)
    pose = np.concatenate([np.zeros((1, 3)), fits.body_pose[frame]])
    began = _now(device)
    state = trained.method.pose_state(
        trained.state, _float32(pose, device), _float32(fits.rest_joints[frame], device)
    )
    view = Camera(_float32(known.K, device), _float32(camera_from_body, device), known.size)
    prediction = draw(trained, state, view, judgement.render).rgb
    seconds = _now(device) - began
    truth = torch.from_numpy(file.full_picture(camera, frame, judgement.render.background))
    box = box_mask(known.size, known.K, camera_from_body, body_box(fits.posed_joints[frame]))
    scores = compare(
        truth.to(device),
        prediction,
        torch.from_numpy(box).to(device),
        judgement.conventions,
        judgement.lpips,
    )
    return Judged(truth, prediction.cpu(), scores, seconds)


def strip_row(file: SequenceFile, place: tuple[int, int], judged: Judged) -> list[UInt8]:
    """Truth, prediction and error of a picture, cut to the part that the file stores."""
    camera, frame = place
    x, y = file.offsets[file.row[camera, frame]].tolist()
    width, height = file.crop_size
    rows, columns = slice(max(y, 0), y + height), slice(max(x, 0), x + width)
    truth, prediction = judged.truth[rows, columns], judged.prediction[rows, columns]
    return [to_bytes(truth), to_bytes(prediction), error_picture(truth, prediction)]


def _float32(array: Float64, device: torch.device) -> Tensor:
    return torch.from_numpy(array).to(device, torch.float32)


def _now(device: torch.device) -> float:
    """Seconds, once the device has done what it was asked."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()
