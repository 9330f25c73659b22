import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import torch
from tests.train.tables.configured import without

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_train.checkpoint import (
    FORMAT,
    FORMAT_VERSION,
    CheckpointInfo,
    Origin,
    load_info,
    save_checkpoint,
)
from actorsnerf_train.config import fewshot, humannerf, pretraining
from actorsnerf_train.records import to_json_object
from actorsnerf_train.result import Evaluation
from actorsnerf_train.result_file import write_result
from actorsnerf_train.tables.entry import gather, label_of
from actorsnerf_train.tables.made import refuse_other_runs, row_label, to_make
from actorsnerf_train.tables.options import TablesOptions
from actorsnerf_train.tables.plan import Run, make_plan

if TYPE_CHECKING:
    from tests.train.conftest import People
    from tests.train.tables.conftest import WriteResult


@pytest.fixture
def options(people: "People", tmp_path: Path) -> TablesOptions:
    return TablesOptions(
        tmp_path / "out",
        data=(people.folder,),
        preset="tiny",
        methods=("actorsnerf", "humannerf"),
        settings=("fewshot-5",),
        steps=10,
        pretrain_steps=100,
    )


@pytest.fixture
def made(evaluation: Evaluation, people: "People") -> Evaluation:
    """What the fitting of ActorsNeRF would have left."""
    digest = SequenceFile(people.eve).digest
    configuration = to_json_object(fewshot("tiny"))
    return replace(
        evaluation, preset="tiny", step=10, data_sha256=digest, configuration=configuration
    )


def finish(run: Run, made: Evaluation) -> None:
    """As if the fitting had been made and evaluated."""
    (run.folder / "evaluation").mkdir(parents=True)
    write_result(run.folder / "evaluation" / "result.json", made)


def finish_category(run: Run, digests: list[str], seed: int = 0) -> None:
    """As if the category training had been made on files of such digests."""
    run.folder.mkdir(parents=True)
    config = replace(pretraining("tiny"), seed=seed)
    info = CheckpointInfo(
        format=FORMAT,
        format_version=FORMAT_VERSION,
        stage="pretrain",
        method="actorsnerf",
        step=100,
        seconds=9.0,
        configuration=to_json_object(config),
        origin=Origin(None, False, None, None, ()),
        data=(),
        setting=None,
        generator="",
        loss_scale={},
        versions={},
        commit=None,
        tensors_sha256="",
    )
    save_checkpoint(run.folder, info, {"model/one": torch.ones(1)})
    data = [["walks", "someone", digest] for digest in digests]
    (run.folder / "config.json").write_text(json.dumps({"data": data}))


def test_what_was_asked_for_may_stay(
    options: TablesOptions, made: Evaluation, people: "People"
) -> None:
    category, fitting, _ = runs = make_plan(options)
    digests = [SequenceFile(path).digest for path in (people.ben, people.ann)]
    finish_category(category, digests)
    began = load_info(category.folder).tensors_sha256
    finish(fitting, replace(made, pretrained_from=began))
    refuse_other_runs(runs, options)
    assert [run.status for run in runs] == ["done", "done", "missing"]


def test_a_run_on_other_data_is_refused(options: TablesOptions, made: Evaluation) -> None:
    _, fitting, _ = runs = make_plan(options)
    finish(fitting, replace(made, data_sha256="1" * 64))
    said = (
        r"actorsnerf-seed0/evaluation/result\.json: is of other data than --data names \(digests "
        r"11111111 there, \w{8} here\): prepared anew since, or other actors\? move its folder away"
    )
    with pytest.raises(UserError, match=said):
        refuse_other_runs(runs, options)


def test_a_category_of_other_actors_is_refused(options: TablesOptions, people: "People") -> None:
    runs = make_plan(options)
    finish_category(runs[0], [SequenceFile(people.ann).digest])
    with pytest.raises(UserError, match=r"category/config\.json: is of other data than --data"):
        refuse_other_runs(runs, options)


def test_a_category_that_was_trained_otherwise_is_refused(
    options: TablesOptions, people: "People"
) -> None:
    runs = make_plan(options)
    digests = [SequenceFile(path).digest for path in (people.ben, people.ann)]
    finish_category(runs[0], digests, seed=4)
    said = (
        r"is of the preset tiny, 100 steps and seed 4, but tiny, 100 steps and seed 0 are asked: "
        r"give --category-seed 4, or move"
    )
    with pytest.raises(UserError, match=said):
        refuse_other_runs(runs, options)


def test_a_fitting_of_another_category_is_refused(
    options: TablesOptions, made: Evaluation, people: "People"
) -> None:
    category, fitting, _ = runs = make_plan(options)
    finish_category(category, [SequenceFile(path).digest for path in (people.ben, people.ann)])
    finish(fitting, made)
    with pytest.raises(UserError, match=r"began from another category training than .*category"):
        refuse_other_runs(runs, options)


def test_a_category_whose_last_checkpoint_is_missing_is_not_done(options: TablesOptions) -> None:
    (run, *_) = make_plan(options)
    finish_category(run, [])
    assert run.status == "done"
    (log,) = [run.folder / "log.jsonl"]
    log.write_text(json.dumps({"step": 200, "seconds": 9.0}) + "\n")
    assert replace(run, steps=200).status == "begun"


def test_a_glance_is_no_evaluation(options: TablesOptions, made: Evaluation) -> None:
    _, fitting, _ = runs = make_plan(options)
    finish(fitting, replace(made, limited=True))
    with pytest.raises(UserError, match=r"only 2 frames were evaluated.*give --max-frames 2"):
        refuse_other_runs(runs, options)
    with pytest.raises(UserError, match="only 2 frames were evaluated"):
        refuse_other_runs(runs, replace(options, max_frames=3))
    refuse_other_runs(runs, replace(options, max_frames=2))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"preset": "small"}, "is of the preset small, 10 steps and the official list"),
        ({"step": 1200}, "is of the preset tiny, 1,200 steps and the official list"),
        ({"list_name": "auto"}, "tiny, 10 steps and the official list are asked"),
    ],
)
def test_a_run_of_another_kind_is_refused(
    options: TablesOptions, made: Evaluation, change: dict[str, object], said: str
) -> None:
    asked = replace(options, list="official")
    _, fitting, _ = runs = make_plan(asked)
    finish(fitting, replace(made, **change))  # type: ignore[arg-type]  # the case's fields
    with pytest.raises(UserError, match=said):
        refuse_other_runs(runs, asked)


def test_recorded_results_stand_for_runs(
    options: TablesOptions, made: Evaluation, write: "WriteResult", tmp_path: Path
) -> None:
    runs = make_plan(options)
    same: dict[str, object] = {"preset": "tiny", "step": 10, "data_sha256": made.data_sha256}
    same["configuration"] = made.configuration
    assert to_make(runs, (), options) == runs
    write((25.0, 0.9, 50.0), **same, seed=1)  # another seed stands for nothing
    assert to_make(runs, gather([tmp_path / "results"]), options) == runs
    other = to_json_object(replace(fewshot("tiny"), precision="bfloat16"))
    path = write((25.0, 0.9, 50.0), **{**same, "configuration": other})
    assert to_make(runs, gather([tmp_path / "results"]), options) == runs
    path.unlink()
    write((25.0, 0.9, 50.0), **same)
    left = to_make(runs, gather([tmp_path / "results"]), options)
    assert [run.folder.name for run in left] == ["eve-fewshot-5-humannerf-seed0"]
    same["configuration"] = to_json_object(humannerf("tiny"))
    write((25.0, 0.9, 50.0), **same, method="humannerf", pretrained_from=None)
    assert to_make(runs, gather([tmp_path / "results"]), options) == ()


def test_a_label_is_what_the_evaluation_will_bear(evaluation: Evaluation) -> None:
    def label(method: str) -> str:
        return row_label(Run(Path(), method, (), "fewshot-5", 0, 1))  # type: ignore[arg-type]

    assert label("actorsnerf") == label_of(evaluation)
    assert label("scratch") == label_of(replace(evaluation, pretrained_from=None))
    assert label("neuralbody") == label_of(replace(evaluation, method="neuralbody"))
    bare = replace(evaluation, configuration=without("body_features"))
    assert label("no-body-features") == label_of(bare)
