from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from actorsnerf_train.tables.entry import gather
from actorsnerf_train.tables.published import published_mean
from actorsnerf_train.tables.table import make_table

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult


def test_the_papers_figures_stand_beside_the_same_experiment_only(
    write: "WriteResult", tmp_path: Path
) -> None:
    for actor in ("387", "393", "394"):
        for setting in ("fewshot-5", "short-video"):
            write(
                (27.0, 0.95, 50.0),
                actor=actor,
                dataset="zju-mocap",
                preset="official",
                setting=setting,
                step=300_000,
            )
    entries = gather([tmp_path])
    table = make_table(entries, "paper")
    five, video = table.rows
    assert published_mean(table, five) == (27.52, 0.9566, 44.9)
    assert published_mean(table, video) is None
    assert published_mean(make_table(entries, "box"), five) is None
    assert published_mean(replace(table, limited=True), five) is None
    assert published_mean(table, replace(five, steps=(500,))) is None
    fewer = make_table(entries[:4], "paper")
    assert published_mean(fewer, fewer.rows[0]) is None


def test_synthetic_actors_have_no_published_figures(write: "WriteResult", tmp_path: Path) -> None:
    write((27.0, 0.95, 50.0), preset="official")
    table = make_table(gather([tmp_path]), "paper")
    assert published_mean(table, table.rows[0]) is None
