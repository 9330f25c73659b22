from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.train.tables.configured import without

from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_train.__main__ import main
from actorsnerf_train.config import humannerf
from actorsnerf_train.health import TrainingError
from actorsnerf_train.options import Resources
from actorsnerf_train.pictures import write_png
from actorsnerf_train.records import to_json_object
from actorsnerf_train.result import CurvePoint, MeanRow, StripLayout, StripRow
from actorsnerf_train.result_file import read_result, write_result
from actorsnerf_train.tables import command
from actorsnerf_train.tables.command import run_tables
from actorsnerf_train.tables.execute import execute
from actorsnerf_train.tables.options import TablesOptions
from actorsnerf_train.tables.plan import Run

if TYPE_CHECKING:
    from tests.train.conftest import People
    from tests.train.tables.conftest import WriteResult


def test_results_become_tables(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.9, 50.0))
    write((24.0, 0.9, 60.0), method="humannerf", step=400, limited=True)
    write((25.5, 0.9, 45.0), setting="fewshot-10")
    told = run_tables(TablesOptions(tmp_path / "out", results=(tmp_path / "results",)))
    names = [Path(line.removeprefix("table: ")).name for line in told]
    assert names == [
        f"{name}_{convention}{ending}"
        for convention in ("paper", "box")
        for name, ending in (
            ("table", ".md"),
            ("table", ".csv"),
            ("table", ".tex"),
            ("lpips", ".png"),
        )
    ]
    text = (tmp_path / "out" / "table_paper.md").read_text()
    assert "**Not at equal steps**" in text
    assert "Only part of the protocol" in text
    assert "Machines: abacus (?)." in text
    assert "table_time.md" not in text


def test_curves_parts_and_pictures_become_files(write: "WriteResult", tmp_path: Path) -> None:
    pictures = (("c1", 30), ("c1", 32))
    curve = (
        CurvePoint(10, 4.0, "box", 20.0, 0.8, 90.0, pictures),
        CurvePoint(500, 100.0, "box", 22.0, 0.9, 60.0, pictures),
    )
    strip = StripLayout((12, 8), 4, ("truth", "prediction", "error"), (StripRow("c1", 30, 12, 8),))
    path = write((25.0, 0.9, 50.0), curve=curve, strip=strip, category_seconds=2160.0)
    write_png(path.parent / "strip.png", np.zeros((8, 44, 3), dtype=np.uint8))
    write((24.0, 0.9, 60.0), configuration=without("deformation"))
    told = run_tables(
        TablesOptions(tmp_path / "out", results=(tmp_path / "results",), conventions=("box",))
    )
    names = [Path(line.removeprefix("table: ")).name for line in told]
    first = ["table_box.md", "table_box.csv", "table_box.tex", "parts_box.md"]
    then = ["table_time.md", "table_time.csv", "table_time.tex", "curves.png"]
    assert names == [*first, *then, "pictures_eve_fewshot-5_official.png"]
    text = (tmp_path / "out" / "table_time.md").read_text()
    assert "of 1 trainings, each the mean over 2 evaluation pictures" in text
    assert "ActorsNeRF, fewshot-5 (official list): **no plateau yet**" in text
    assert "table_time.md" in (tmp_path / "out" / "table_box.md").read_text()


def test_what_is_missing_is_made_and_nothing_twice(
    people: "People", tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []

    def noted(run: Run, *rest: object) -> None:
        made.append(run.folder.name)
        execute(run, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(command, "execute", noted)
    options = TablesOptions(
        tmp_path,
        data=(people.eve,),
        preset="tiny",
        methods=("humannerf",),
        settings=("fewshot-5",),
        steps=2,
        max_frames=1,
        use=Resources(workers=0, check=False),
    )
    run_tables(options)
    run_tables(options)
    assert made == ["eve-fewshot-5-humannerf-seed0"]
    assert "HumanNeRF" in (tmp_path / "table_box.md").read_text()


def test_a_collapsed_fitting_does_not_cost_the_others(
    people: "People", write: "WriteResult", tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []

    def collapsing(run: Run, *rest: object) -> None:
        made.append(run.folder.name)
        if run.method == "humannerf" or run.setting is None:
            raise TrainingError("step 9: the actor has vanished.")

    monkeypatch.setattr(command, "execute", collapsing)
    write((20.0, 0.9, 80.0))
    options = TablesOptions(
        tmp_path,
        data=(people.eve,),
        preset="tiny",
        methods=("humannerf", "scratch"),
        settings=("fewshot-5",),
        use=Resources(workers=0, check=False),
    )
    told = run_tables(options)
    assert made == ["eve-fewshot-5-humannerf-seed0", "eve-fewshot-5-scratch-seed0"]
    assert told[0] == "not made: eve-fewshot-5-humannerf-seed0: step 9: the actor has vanished."
    assert any(line.startswith("table: ") for line in told)
    said = "**Not made**: eve-fewshot-5-humannerf-seed0: step 9: the actor has vanished."
    assert said in (tmp_path / "table_box.md").read_text()
    with monkeypatch.context() as patch:
        patch.setattr(command, "execute", lambda *_: None)
        run_tables(options)  # this time it succeeds
    assert "Not made" not in (tmp_path / "table_box.md").read_text()
    with pytest.raises(TrainingError, match="vanished"):
        run_tables(replace(options, data=(people.ann, people.eve), methods=("actorsnerf",)))
    assert made[2:] == ["category"]


def test_a_dry_run_only_tells(
    people: "People", tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["tables", "--data", str(people.folder), "--out", str(tmp_path / "out"), "--dry-run"]
    words += ["--preset", "tiny", "--settings", "fewshot-5"]
    assert main(words) == 0
    told = capsys.readouterr().out
    assert "missing category  (300 steps)" in told
    assert "missing eve-fewshot-5-humannerf-seed0  (200 steps)" in told
    assert "not counting 4 runs" in told
    assert not (tmp_path / "out").exists()


def test_what_is_recorded_is_not_planned(
    people: "People", write: "WriteResult", tmp_path: Path
) -> None:
    digest = SequenceFile(people.eve).digest
    learned = {"method": "humannerf", "configuration": to_json_object(humannerf("tiny"))}
    write((24.0, 0.9, 60.0), preset="tiny", data_sha256=digest, step=2, **learned)
    options = TablesOptions(
        tmp_path / "out",
        data=(people.folder,),
        results=(tmp_path / "results",),
        preset="tiny",
        methods=("humannerf", "scratch"),
        settings=("fewshot-5",),
        steps=2,
        dry_run=True,
    )
    told = run_tables(options)
    assert [line.split("  ")[0] for line in told[:-1]] == ["missing eve-fewshot-5-scratch-seed0"]


def test_bad_input_is_one_sentence_and_exit_status_2(
    people: "People", known_eve: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--preset", "tiny", "--dry-run", "--settings"]
    cases: dict[str, list[Path | str]] = {
        "no prepared file of a held-out actor": [people.ann, *asked, "fewshot-5"],
        "no file of a training actor": [people.eve, *asked, "fewshot-5"],
        "its 20 frames are too few": [people.folder, *asked, "fewshot-300"],
        "figures on a known person mean nothing": [people.folder, known_eve, *asked, "fewshot-5"],
    }
    for said, words in cases.items():
        out = tmp_path / "out"
        assert main(["tables", "--out", str(out), "--data", *map(str, words)]) == 2, said
        error = capsys.readouterr().err
        assert error.startswith("error: ") and error.count("\n") == 1 and said in error
        assert not out.exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"data_sha256": "1" * 64}, "was measured on another data_sha256 than in"),
        ({"means": (MeanRow("strict", 25.0, 0.9, None),)}, "no figures under the convention paper"),
    ],
)
def test_what_cannot_share_a_table_is_exit_status_2(
    write: "WriteResult",
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: dict[str, object],
    said: str,
) -> None:
    write((25.0, 0.9, 50.0))
    path = write((24.0, 0.9, 60.0), seed=1)
    other = replace(read_result(path), **change)  # type: ignore[arg-type]  # the case's fields
    write_result(path, other)
    out = tmp_path / "out"
    assert main(["tables", "--out", str(out), "--results", str(tmp_path / "results")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and said in error
    assert not list(out.glob("*"))


def test_exit_statuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tables", "--out", str(tmp_path)]) == 2
    assert "no result of a few-shot training" in capsys.readouterr().err
    assert main(["tables", "--out", str(tmp_path), "--dry-run"]) == 2
    assert "no run is planned" in capsys.readouterr().err
