import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.tables.options import TablesOptions
from actorsnerf_train.tables.plan import Run, hours_left, make_plan

if TYPE_CHECKING:
    from tests.train.conftest import People


@pytest.fixture
def options(people: "People", tmp_path: Path) -> TablesOptions:
    return TablesOptions(
        tmp_path,
        data=(people.folder,),
        preset="tiny",
        methods=("actorsnerf", "humannerf", "no-deformation"),
        settings=("fewshot-5",),
        seeds=(0, 1),
        steps=10,
        pretrain_steps=100,
    )


def train(run: Run, steps: int, seconds: float) -> None:
    """As if the run had been trained that far."""
    run.folder.mkdir(parents=True)
    entry = {"step": steps, "seconds": seconds, "lpips": 0.1}
    (run.folder / "log.jsonl").write_text(json.dumps(entry) + "\n")
    (run.folder / "checkpoints").mkdir()
    (run.folder / "checkpoints" / f"step_{steps:06d}.json").write_text("{}")
    (run.folder / "checkpoints" / "latest").write_text(f"step_{steps:06d}\n")


def test_categories_come_first_and_rows_begin_from_theirs(
    options: TablesOptions, people: "People"
) -> None:
    runs = make_plan(options)
    assert [run.folder.name for run in runs] == [
        "category",
        "category-no-deformation",
        "eve-fewshot-5-actorsnerf-seed0",
        "eve-fewshot-5-humannerf-seed0",
        "eve-fewshot-5-no-deformation-seed0",
        "eve-fewshot-5-actorsnerf-seed1",
        "eve-fewshot-5-humannerf-seed1",
        "eve-fewshot-5-no-deformation-seed1",
    ]
    assert runs[0].data == (people.ann, people.ben)
    assert runs[0].steps == 100
    assert {run.data for run in runs[2:]} == {(people.eve,)}
    origins = [run.category.name if run.category else None for run in runs[2:5]]
    assert origins == ["category", None, "category-no-deformation"]


def test_other_seeds_of_the_fittings_keep_the_category(options: TablesOptions) -> None:
    first = make_plan(replace(options, seeds=(0,)))
    later = make_plan(replace(options, seeds=(1, 2)))
    assert later[:2] == first[:2] and first[0].seed == 0
    assert {run.seed for run in later[2:]} == {1, 2}
    asked = make_plan(replace(options, seeds=(1, 2), category_seed=1))
    assert [run.seed for run in asked[:2]] == [1, 1]


def test_status_and_time_left(options: TablesOptions) -> None:
    runs = make_plan(options)
    assert {run.status for run in runs} == {"missing"}
    assert hours_left(runs) == (0.0, 8)
    train(runs[0], 100, 400.0)
    train(runs[2], 5, 36.0)
    assert (runs[0].status, runs[2].status) == ("done", "begun")
    # Left of ActorsNeRF's fittings: 5 steps and 10 steps of 7.2 s.
    hours, unknown = hours_left(runs)
    assert hours == pytest.approx(15 * 7.2 / 3600)
    assert unknown == 5
    (runs[2].folder / "evaluation").mkdir()
    (runs[2].folder / "evaluation" / "result.json").write_text("{}")
    assert runs[2].status == "done"


def test_the_baseline_alone_needs_no_category(options: TablesOptions, people: "People") -> None:
    alone = replace(options, data=(people.eve,), methods=("humannerf", "neuralbody", "scratch"))
    assert all(run.setting for run in make_plan(alone))
    with pytest.raises(UserError, match="no file of a training actor"):
        make_plan(replace(options, data=(people.eve,)))


def test_someone_must_be_held_out(options: TablesOptions, people: "People") -> None:
    with pytest.raises(UserError, match="no prepared file of a held-out actor"):
        make_plan(replace(options, data=(people.ann, people.ben)))


def test_a_sequence_too_short_for_a_setting(options: TablesOptions) -> None:
    said = "actor eve has no setting fewshot-300 in protocol generic: its 20 frames are too few"
    with pytest.raises(UserError, match=said):
        make_plan(replace(options, settings=("fewshot-5", "fewshot-300")))


def test_two_sequences_of_a_held_out_actor_are_refused(
    options: TablesOptions, people: "People", tmp_path: Path
) -> None:
    again = tmp_path / "eve_again.h5"
    shutil.copy(people.eve, again)
    with pytest.raises(UserError, match=r"is of actor eve, like .*\.h5: a table has one sequence"):
        make_plan(replace(options, data=(people.folder, again)))


def test_an_actor_on_both_sides_is_refused(
    options: TablesOptions, people: "People", known_eve: Path
) -> None:
    said = r"eve\.h5: actor eve is held out here but a training actor in .*known\.h5: figures"
    with pytest.raises(UserError, match=said):
        make_plan(replace(options, data=(people.folder, known_eve)))
