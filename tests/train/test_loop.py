from dataclasses import replace
from pathlib import Path

import pytest
import torch

from actorsnerf_datasets.torch_dataset import Sample
from actorsnerf_train.batches import SampleSource
from actorsnerf_train.checkpoint import load_checkpoint
from actorsnerf_train.loop import train


class Killed(Exception):
    """Stands for the end of the process."""


class UntilKilled:
    """A source that ends the process at an index."""

    def __init__(self, source: SampleSource, end: int) -> None:
        self.source = source
        self.end = end

    def __getitem__(self, index: int) -> Sample:
        if index == self.end:
            raise Killed
        return self.source[index]


def test_2n_steps_are_n_a_kill_and_n_bit_for_bit(make_training, config, tmp_path: Path) -> None:
    whole = load_checkpoint(train(make_training(tmp_path / "whole", config)))
    broken = make_training(tmp_path / "broken", config)
    with pytest.raises(Killed):
        train(replace(broken, source=UntilKilled(broken.source, 6)))
    assert load_checkpoint(tmp_path / "broken").info.step == 4
    resumed = load_checkpoint(train(make_training(tmp_path / "broken", config)))
    assert resumed.tensors.keys() == whole.tensors.keys()
    for name, tensor in whole.tensors.items():
        assert torch.equal(tensor, resumed.tensors[name]), name
    assert resumed.info.tensors_sha256 == whole.info.tensors_sha256
    assert resumed.info.generator == whole.info.generator
    lines = [(tmp_path / run / "log.jsonl").read_text().count("\n") for run in ("whole", "broken")]
    assert lines == [4, 4]
