import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train import evaluate as evaluation_module
from actorsnerf_train.__main__ import main
from actorsnerf_train.lpips import LpipsFiles
from actorsnerf_train.report.command import ReportOptions, run_report

if TYPE_CHECKING:
    from tests.train.report.conftest import People


@pytest.fixture(autouse=True)
def without_lpips(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine where the weights were never installed."""

    def nothing(files: LpipsFiles) -> None:
        return None

    monkeypatch.setattr(evaluation_module, "load_lpips", nothing)


@pytest.fixture
def options(fewshot_run: Path, people: "People", tmp_path: Path) -> ReportOptions:
    return ReportOptions(
        (fewshot_run,),
        (people.ann, people.eve),
        tmp_path / "report",
        points=("half-samples",),
        samples=12,
        frames=1,
        rounds=1,
        reference_share=0.5,
        memory=False,
        training=False,
        scaling=False,
    )


def test_a_report_leaves_json_table_and_plot(options: ReportOptions) -> None:
    told = run_report(options)
    assert sorted(path.name for path in options.out.iterdir()) == [
        "pareto.png",
        "report.json",
        "report.md",
    ]
    record = json.loads((options.out / "report.json").read_text())
    assert record["schema"] == "actorsnerf-speed-report" and record["seed"] == 0
    assert record["machine"]["threads"] >= 1 and record["gemm"]["float32"] > 0
    (actor,) = record["actors"]
    assert actor["actor"] == "eve" and actor["preset"] == "tiny" and actor["size"] == [80, 80]
    assert actor["samples_per_ray"] == 12
    names = [row["name"] for row in actor["points"]]
    assert names == ["reference", "complete", "exact", "half-samples"]
    assert actor["points"][2]["reference_largest"] <= 1 / 255
    assert actor["points"][0]["psnr"] is None  # a share of the rays only
    assert told[0].startswith(f"eve, {actor['method']}: use {actor['recommended']}")
    text = (options.out / "report.md").read_text()
    assert "LPIPS not computed" in text and f"**Use `{actor['recommended']}`**" in text


def test_a_report_on_neural_body(options: ReportOptions, neuralbody_run: Path) -> None:
    """Its shell is exact, its training step the reference's; it has no parts to leave out."""
    run_report(
        dataclasses.replace(
            options,
            checkpoints=(neuralbody_run,),
            points=("fast",),
            reference_share=0.2,
            training=True,
            scaling=True,
        )
    )
    (actor,) = json.loads((options.out / "report.json").read_text())["actors"]
    assert actor["method"] == "Neural Body"
    assert [row["name"] for row in actor["points"]][-1] == "fast"
    assert actor["points"][1]["reference_largest"] <= 1 / 255
    assert actor["parts"] == [] and len(actor["training"]) == 2


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"reference_share": 0.0}, "--reference-share is 0, expected more than 0"),
        ({"reference_share": 1.5}, "--reference-share is 1.5, expected more than 0"),
        ({"rounds": 0}, "--rounds is 0, expected at least 1"),
        ({"frames": 0}, "--frames is 0, expected at least 1"),
    ],
)
def test_wrong_numbers_are_refused(
    options: ReportOptions, change: dict[str, int | float], sentence: str
) -> None:
    with pytest.raises(UserError, match=sentence):
        run_report(dataclasses.replace(options, **change))  # type: ignore[arg-type]  # by name


def test_bad_input_is_one_sentence(
    category_run: Path, options: ReportOptions, people: "People", capsys: pytest.CaptureFixture[str]
) -> None:
    def failed(checkpoint: Path, data: Path) -> str:
        words = ("report", checkpoint, "--data", data, "--out", options.out)
        assert main([str(word) for word in words]) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: ") and error.count("\n") == 1
        return error

    fitted = options.checkpoints[0]
    assert "is a category checkpoint, which knows no actor" in failed(category_run, people.eve)
    assert "was fitted to eve, but ann.h5 shows ann" in failed(fitted, people.ann)
    assert "nowhere.h5" in failed(fitted, people.folder / "nowhere.h5")
    assert "no such run folder or checkpoint" in failed(options.out / "none", people.eve)
    assert not options.out.exists()
