import pytest
import torch

from actorsnerf_train.config import TrainConfig, fewshot
from actorsnerf_train.methods import build_method
from actorsnerf_train.optimiser import BASE_RATE, adam, set_rates
from actorsnerf_train.schedule import Schedule

CPU = torch.device("cpu")
OFFICIAL = {
    "encoder": 5e-4,
    "skinning": 5e-5,
    "deformation": 5e-5,
    "sparse": 5e-4,
    "radiance": 5e-4,
}


def test_every_parameter_is_in_the_group_of_its_part(config: TrainConfig) -> None:
    method = build_method(config, CPU)
    parts = method.parts()
    assert set(parts) == set(OFFICIAL)
    optimiser = adam(parts, fewshot("official").rates)
    rates = {id(p): group["lr"] for group in optimiser.param_groups for p in group["params"]}
    for name, part in parts.items():
        assert {rates[id(p)] for p in part.parameters()} == {OFFICIAL[name]}
    assert len(rates) == len(list(method.parameters()))


def test_frozen_parts_are_in_no_group(config: TrainConfig) -> None:
    method = build_method(config, CPU)
    method.freeze_category_prior()
    optimiser = adam(method.parts(), config.rates)
    trained = {id(p) for group in optimiser.param_groups for p in group["params"]}
    for name, parameter in method.named_parameters():
        frozen = name.split(".")[0] in ("encoder", "skinning")
        assert (id(parameter) in trained) is not frozen, name


def test_rates_follow_the_schedule(config: TrainConfig) -> None:
    optimiser = adam(build_method(config, CPU).parts(), config.rates)
    factor = set_rates(optimiser, Schedule(10, 0, 500_000), 5)
    assert factor == pytest.approx(0.1**0.5)
    for group in optimiser.param_groups:
        assert group["lr"] == pytest.approx(group[BASE_RATE] * 0.1**0.5)
    set_rates(optimiser, Schedule(10, 0, 500_000), 0)
    assert [group["lr"] for group in optimiser.param_groups] == [
        group[BASE_RATE] for group in optimiser.param_groups
    ]
