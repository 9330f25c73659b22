from collections.abc import Callable
from pathlib import Path

import torch

from actorsnerf_train.config import TrainConfig
from actorsnerf_train.loop import Training
from actorsnerf_train.methods import actorsnerf, know_actor
from actorsnerf_train.pictures import STRIP_GAP, to_bytes
from actorsnerf_train.snapshot import snapshot


def test_truth_stands_first_and_the_method_stays_as_it_was(
    make_training: Callable[[Path, TrainConfig], Training], config: TrainConfig, tmp_path: Path
) -> None:
    training = make_training(tmp_path, config)
    method = training.method.train()
    method.freeze_category_prior()
    before = {name: value.clone() for name, value in method.state_dict().items()}
    sample = training.source[0]
    known = know_actor(method, sample.supports)
    picture = snapshot(method, sample, known, 3.0, config.render)
    height, width = sample.target.alpha.shape
    assert picture.shape == (height, 3 * width + 2 * STRIP_GAP, 3)
    truth = sample.target.image * sample.target.alpha[..., None]
    assert (picture[:, :width] == to_bytes(truth)).all()
    assert method.training
    encoder = actorsnerf(method).encoder
    assert encoder is not None
    assert not encoder.training
    after = method.state_dict()
    assert all(torch.equal(before[name], after[name]) for name in before)
