from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.stability.bench import Bench, make_bench, view_as

if TYPE_CHECKING:
    from tests.train.conftest import People

CPU = torch.device("cpu")


def test_three_precisions_of_one_method(bench: Bench) -> None:
    names = [subject.precision for subject in bench.subjects]
    assert names == ["float64", "float32", "bfloat16"]
    assert [subject.like.dtype for subject in bench.subjects] == [
        torch.float64,
        torch.float32,
        torch.float32,
    ]
    double, single, half = (dict(s.method.named_parameters()) for s in bench.subjects)
    for name, weight in single.items():
        assert torch.equal(weight.double(), double[name])
        assert torch.equal(weight, half[name])
    assert bench.subjects[2].method.network_dtype == torch.bfloat16


def test_an_untrained_method_is_awake(bench: Bench) -> None:
    body = bench.subjects[0].state.body
    assert float(body.residual.detach().abs().mean()) > 0.1
    deformation = bench.subjects[0].method.deformation
    assert deformation is not None
    assert float(deformation.offset.weight.detach().std()) > 0.01


def test_a_view_in_another_precision(bench: Bench) -> None:
    view = view_as(bench.subjects[1].supports[0], torch.float64)
    assert view.image.dtype == view.K.dtype == torch.float64
    assert view.actor == "invented"


def test_a_fitted_actor_and_the_fastest_frames(fewshot_run: Path, people: "People") -> None:
    made = make_bench(fewshot_run, people.eve, "small", CPU)
    assert made.subjects[1].supports[0].actor == "eve"
    assert made.config.preset == "tiny"
    assert made.title.endswith("on actor eve, the fastest frames of eve.h5")
    assert made.subjects[1].poses.shape == (3, 24, 3)
    assert not bool(made.subjects[1].poses[:, 0].any())


def test_a_category_takes_the_files_actor(category_run: Path, people: "People") -> None:
    made = make_bench(category_run, people.ann, "small", CPU)
    assert {view.actor for view in made.subjects[0].supports} == {"ann"}
    assert len({view.frame for view in made.subjects[0].supports}) == 3
    alone = make_bench(category_run, None, "small", CPU)
    assert alone.subjects[0].supports[0].actor == "invented"


def test_no_checkpoint(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no checkpoint"):
        make_bench(tmp_path, None, "tiny", CPU)
