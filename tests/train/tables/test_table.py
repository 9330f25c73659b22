from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from actorsnerf_train.tables.entry import gather
from actorsnerf_train.tables.table import MEAN, make_table

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult


def test_mean_over_seeds_then_over_actors(write: "WriteResult", tmp_path: Path) -> None:
    write((24.0, 0.90, 50.0), seed=0)
    write((26.0, 0.92, 40.0), seed=1)
    write((30.0, 0.94, 20.0), seed=0, actor="zoe")
    write((31.0, 0.96, 10.0), seed=1, actor="zoe")
    (row,) = make_table(gather([tmp_path]), "paper").rows
    eve, mean = row.cells["eve"], row.cells[MEAN]
    assert (eve.psnr.value, eve.seeds) == (25.0, 2)
    assert eve.psnr.spread == pytest.approx(2**0.5)
    assert eve.lpips_x1000 is not None
    assert eve.lpips_x1000.value == 45.0
    # Seed 0: (24 + 30) / 2 = 27; seed 1: (26 + 31) / 2 = 28.5.
    assert mean.psnr.value == pytest.approx(27.75)
    assert mean.psnr.spread == pytest.approx(1.5 / 2**0.5)


def test_the_mean_takes_only_seeds_that_every_actor_has(
    write: "WriteResult", tmp_path: Path
) -> None:
    write((24.0, 0.9, 50.0), seed=0)
    write((99.0, 0.9, 50.0), seed=1)
    write((30.0, 0.9, 20.0), seed=0, actor="zoe")
    write((20.0, 0.9, 20.0), seed=5, method="humannerf", actor="zoe")
    ours, theirs = make_table(gather([tmp_path]), "paper").rows
    assert (ours.cells[MEAN].psnr.value, ours.cells[MEAN].seeds) == (27.0, 1)
    assert ours.cells[MEAN].psnr.spread is None
    assert set(theirs.cells) == {"zoe"}


def test_rows_go_by_shots_short_video_last(write: "WriteResult", tmp_path: Path) -> None:
    for setting in ("short-video", "fewshot-30", "fewshot-5"):
        write((24.0, 0.9, 50.0), setting=setting)
        write((24.0, 0.9, 50.0), setting=setting, method="humannerf", step=400)
    table = make_table(gather([tmp_path]), "box")
    assert [(row.setting, row.label, row.steps) for row in table.rows] == [
        ("fewshot-5", "ActorsNeRF", (500,)),
        ("fewshot-5", "HumanNeRF", (400,)),
        ("fewshot-30", "ActorsNeRF", (500,)),
        ("fewshot-30", "HumanNeRF", (400,)),
        ("short-video", "ActorsNeRF", (500,)),
        ("short-video", "HumanNeRF", (400,)),
    ]
    assert table.rows[0].cells["eve"].psnr.value == 22.0


def test_lpips_that_was_not_computed_is_no_number(write: "WriteResult", tmp_path: Path) -> None:
    write((24.0, 0.9, None))
    (row,) = make_table(gather([tmp_path]), "paper").rows
    assert row.cells["eve"].lpips_x1000 is None
