import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from actorsnerf_datasets.torch_dataset import Sample
from actorsnerf_train.batches import SampleSource, jitter_generator, sample_to
from actorsnerf_train.checkpoint import load_checkpoint
from actorsnerf_train.config import TrainConfig
from actorsnerf_train.health import HealthLimits, TrainingError
from actorsnerf_train.loop import Training, known_actor, train
from actorsnerf_train.methods import KnownActor, know_actor, window_at
from actorsnerf_train.objective import Objective

MakeTraining = Callable[[Path, TrainConfig], Training]


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


class Spoiled:
    """A source whose pictures are no numbers from an index on."""

    def __init__(self, source: SampleSource, begin: int) -> None:
        self.source = source
        self.begin = begin

    def __getitem__(self, index: int) -> Sample:
        sample = self.source[index]
        if index < self.begin:
            return sample
        image = torch.full_like(sample.target.image, math.nan)
        return replace(sample, target=replace(sample.target, image=image))


class Repeated:
    """A source of one sample."""

    def __init__(self, source: SampleSource) -> None:
        self.sample = source[0]

    def __getitem__(self, index: int) -> Sample:
        return self.sample


def test_2n_steps_are_n_a_kill_and_n_bit_for_bit(
    make_training: MakeTraining, config: TrainConfig, tmp_path: Path
) -> None:
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
    # and a finished run is not trained further
    assert load_checkpoint(train(make_training(tmp_path / "whole", config))).info == whole.info


def test_training_lowers_the_loss(
    make_training: MakeTraining, config: TrainConfig, tmp_path: Path
) -> None:
    schedule = replace(config.schedule, steps=16)
    every = replace(config.every, log=4, checkpoint=0)
    training = make_training(tmp_path, replace(config, schedule=schedule, every=every))
    train(replace(training, source=Repeated(training.source)))
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [4, 8, 12, 16]
    assert lines[-1]["loss"] < 0.9 * lines[0]["loss"]
    assert lines[-1]["open_bands"] == config.actorsnerf.deformation_net.octaves
    assert (tmp_path / "pictures" / "step_000016.png").is_file()


def test_random_backgrounds_are_learned_from_and_come_again(
    make_training: MakeTraining, config: TrainConfig, tmp_path: Path
) -> None:
    random = replace(config, background="random", schedule=replace(config.schedule, steps=2))
    digests = [
        load_checkpoint(train(make_training(tmp_path / name, one))).info.tensors_sha256
        for name, one in (
            ("one", random),
            ("two", random),
            ("fixed", replace(random, background="fixed")),
        )
    ]
    assert digests[0] == digests[1] != digests[2]


def test_a_spoiled_picture_stops_and_the_last_good_checkpoint_stays(
    make_training: MakeTraining, config: TrainConfig, tmp_path: Path
) -> None:
    training = make_training(tmp_path, config)
    with pytest.raises(TrainingError, match="step 5: the loss of actor"):
        train(replace(training, source=Spoiled(training.source, 5)))
    kept = load_checkpoint(tmp_path)
    assert kept.info.step == 4
    assert all(tensor.isfinite().all() for tensor in kept.tensors.values())


def test_the_last_step_is_judged_before_it_is_saved(
    make_training: MakeTraining, config: TrainConfig, tmp_path: Path
) -> None:
    limits = HealthLimits(window=1000, grace=0, least_inside=1.1)  # nobody is so opaque
    training = make_training(tmp_path, replace(config, health=limits))
    with pytest.raises(TrainingError, match=f"step {config.schedule.steps - 1}: .* has vanished"):
        train(training)
    assert load_checkpoint(tmp_path).info.step < config.schedule.steps


def test_accumulation_is_the_mean_gradient(
    make_training: MakeTraining, config: TrainConfig, tmp_path: Path
) -> None:
    two = replace(config, schedule=replace(config.schedule, steps=1), accumulation=2)
    train(make_training(tmp_path, two))
    memory = load_checkpoint(tmp_path).part("optimiser")
    training = make_training(tmp_path / "again", two)
    method = training.method.train()
    objective = Objective(method, training.perceptual, two.losses, two.render)
    for index in (0, 1):
        sample = training.source[index]
        known = know_actor(method, sample.supports)
        jitter = jitter_generator(two.seed, index, training.device)
        outcome = objective(sample, known, window_at(two, 0), jitter)
        outcome.losses.total.backward()
    for name, parameter in method.named_parameters():
        if parameter.grad is not None:
            # Adam's first memory is a tenth of the gradient
            torch.testing.assert_close(memory[f"{name}/exp_avg"], 0.1 * parameter.grad / 2)
    assert "radiance.colour_out.weight/exp_avg" in memory
    # before its kick-in the deformation gets no gradient, so the optimiser never saw it
    assert not any(name.startswith("deformation") for name in memory)


def test_two_sequences_of_one_person_are_known_apart(
    make_training: MakeTraining, config: TrainConfig, tmp_path: Path
) -> None:
    training = make_training(tmp_path, config)
    first, second = (
        next(s for s in map(training.source.__getitem__, range(50)) if s.target.actor == name)
        for name in ("ann", "ben")
    )
    actors: dict[bytes, KnownActor] = {}
    known = known_actor(actors, training.method, first, first.supports)
    on_device = sample_to(first, torch.device("meta")).supports  # has no numbers to look at
    assert known_actor(actors, training.method, first, on_device) is known
    renamed = replace(second, target=replace(second.target, actor="ann"))
    assert known_actor(actors, training.method, renamed, renamed.supports) is not known
