from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest
import torch

from actorsnerf_datasets.body_box import body_box, box_mask
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.states import RenderOptions
from actorsnerf_train.judge import Judgement, judge, strip_row
from actorsnerf_train.trained import TrainedActor, load_trained


class People(Protocol):
    eve: Path


@pytest.fixture
def file(people: People) -> SequenceFile:
    return SequenceFile(people.eve)


@pytest.fixture
def trained(fewshot_run: Path) -> TrainedActor[ActorsNeRFState]:
    return load_trained(fewshot_run, torch.device("cpu"))


def test_an_empty_prediction_by_hand(
    file: SequenceFile, trained: TrainedActor[ActorsNeRFState]
) -> None:
    """With an unreachable threshold nothing is there, and the errors are the truth's own."""
    ground = (0.0, 0.0, 0.0)
    judgement = Judgement(("paper", "box"), RenderOptions(8, 2.0, ground), None)
    judged = judge(trained, file, (1, 6), judgement)
    truth = file.full_picture(1, 6, ground).astype(np.float64)
    assert np.array_equal(judged.truth.numpy(), truth.astype(np.float32))
    assert judged.prediction.shape == truth.shape and not judged.prediction.any()
    assert judged.scores["paper"].psnr == pytest.approx(-10 * np.log10((truth**2).mean()))
    camera, fits = file.header.cameras[1], file.header.fits
    box = body_box(fits.posed_joints[6])
    inside = box_mask(camera.size, camera.K, file.camera_from_body(1, 6), box)
    expected = -10 * np.log10((truth[inside] ** 2).mean())
    assert judged.scores["box"].psnr == pytest.approx(expected)
    assert judged.scores["box"].psnr < judged.scores["paper"].psnr
    assert judged.seconds > 0


def test_the_truth_lies_on_the_methods_background(
    file: SequenceFile, trained: TrainedActor[ActorsNeRFState]
) -> None:
    white = RenderOptions(8, 2.0, (1.0, 1.0, 1.0))
    judged = judge(trained, file, (0, 2), Judgement(("strict",), white, None))
    assert judged.truth[0, 0].tolist() == [1.0, 1.0, 1.0]
    assert (judged.prediction == 1).all()
    alpha = torch.from_numpy(file.full_alpha(0, 2))
    straight = judge(
        trained,
        file,
        (0, 2),
        Judgement(("strict",), replace(white, background=(0.0, 0.0, 0.0)), None),
    )
    assert torch.allclose(judged.truth, straight.truth + (1 - alpha[..., None]), atol=1e-6)


def test_the_strip_shows_what_the_file_stores(
    file: SequenceFile, trained: TrainedActor[ActorsNeRFState]
) -> None:
    judged = judge(trained, file, (1, 6), Judgement(("strict",), RenderOptions(8), None))
    truth, prediction, error = strip_row(file, (1, 6), judged)
    picture = file.picture(1, 6)
    x, y = picture.offset
    width, height = file.crop_size
    whole = (judged.truth * 255).round().numpy().astype(np.uint8)
    assert np.array_equal(truth, whole[max(y, 0) : y + height, max(x, 0) : x + width])
    assert truth.shape == prediction.shape == error.shape
