from pathlib import Path
from typing import Protocol

import pytest
import torch

from actorsnerf_model.learned_method import LearnedMethod
from actorsnerf_model.states import RenderOptions
from actorsnerf_train.checkpoint import CheckpointError, load_checkpoint
from actorsnerf_train.trained import load_trained, with_samples

CPU = torch.device("cpu")


class People(Protocol):
    eve: Path


def test_an_actor_comes_from_the_checkpoint_alone(
    fewshot_run: Path, people: People, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved = tmp_path / "elsewhere.h5"
    people.eve.rename(moved)
    try:
        trained = load_trained(fewshot_run, CPU)
    finally:
        moved.rename(people.eve)
    assert trained.actor == "eve" and trained.device == CPU
    assert len(trained.supports) == trained.config.model.views
    checkpoint = load_checkpoint(fewshot_run)
    assert trained.info == checkpoint.info
    assert trained.path == checkpoint.path


def test_loading_twice_gives_the_same_actor(fewshot_run: Path) -> None:
    first, second = (load_trained(fewshot_run, CPU).state for _ in range(2))
    assert first.maps is not None and second.maps is not None
    assert torch.equal(first.maps.table, second.maps.table)
    assert not first.maps.table.requires_grad


def test_a_state_is_float32_however_its_method_was_trained(
    fewshot_run: Path, bfloat16_run: Path
) -> None:
    exact, rough = load_trained(fewshot_run, CPU), load_trained(bfloat16_run, CPU)
    assert isinstance(exact.method, LearnedMethod) and isinstance(rough.method, LearnedMethod)
    assert exact.method.network_dtype == torch.float32
    assert rough.method.network_dtype == torch.bfloat16
    assert torch.equal(exact.state.maps.table, rough.state.maps.table)
    for one, other in zip(exact.state.levels, rough.state.levels, strict=True):
        assert torch.equal(one.features, other.features)


def test_a_category_checkpoint_knows_no_actor(category_run: Path) -> None:
    with pytest.raises(
        CheckpointError, match="is a category checkpoint, which knows no actor; fit"
    ):
        load_trained(category_run, CPU)


def test_samples_are_replaced_only_where_given() -> None:
    options = RenderOptions(samples=12, threshold=0.5)
    assert with_samples(options, None) is options
    assert with_samples(options, 7) == RenderOptions(samples=7, threshold=0.5)
