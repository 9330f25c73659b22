from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from actorsnerf_train.checkpoint import load_checkpoint
from actorsnerf_train.options import Resources
from actorsnerf_train.result_file import read_result
from actorsnerf_train.tables.execute import execute
from actorsnerf_train.tables.options import TablesOptions
from actorsnerf_train.tables.plan import Run

if TYPE_CHECKING:
    from tests.train.conftest import People

OPTIONS = TablesOptions(
    Path("nowhere"), preset="tiny", max_frames=1, use=Resources(workers=0, check=False)
)


def test_an_ablation_from_category_to_result(people: "People", tmp_path: Path) -> None:
    category = Run(
        tmp_path / "category-no-deformation", "no-deformation", (people.ann,), None, 0, 2
    )
    execute(category, replace(OPTIONS, trunk_file=Path("not-asked-for.pth")))
    assert category.status == "done"
    assert not any("deformation" in n for n in load_checkpoint(category.folder).part("model"))
    run = Run(tmp_path / "eve", "no-deformation", (people.eve,), "fewshot-5", 3, 2)
    execute(run, OPTIONS)
    assert run.status == "done"
    result = read_result(run.folder / "evaluation")
    assert (result.seed, result.step, result.limited) == (3, 2, True)
    assert result.pretrained_from == load_checkpoint(category.folder).info.tensors_sha256


@pytest.mark.parametrize("method", ["humannerf", "neuralbody", "scratch"])
def test_rows_without_a_category(people: "People", tmp_path: Path, method: str) -> None:
    run = Run(tmp_path / method, method, (people.eve,), "fewshot-5", 0, 2)  # type: ignore[arg-type]
    execute(run, OPTIONS)
    result = read_result(run.folder / "evaluation")
    assert result.method == ("actorsnerf" if method == "scratch" else method)
    assert result.pretrained_from is None
    assert result.encoder == ("resnet18" if method == "scratch" else None)
