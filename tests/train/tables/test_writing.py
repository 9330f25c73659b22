import csv
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from actorsnerf_train.tables.entry import gather
from actorsnerf_train.tables.table import Table, make_table
from actorsnerf_train.tables.writing import comma_separated, latex, markdown, write_table

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult


@pytest.fixture
def table(write: "WriteResult", tmp_path: Path) -> Table:
    write((25.0, 0.91, 40.0))
    write((27.0, 0.93, 30.0), seed=1, category_seconds=2160.0)
    write((24.0, 0.95, None), method="humannerf", pretrained_from=None, step=450)
    return make_table(gather([tmp_path]), "paper")


def test_markdown(table: Table) -> None:
    lines = markdown(table).splitlines()
    assert lines[0].startswith("Convention `paper`, preset `small`, data set synthetic")
    assert lines[2] == "| setting | list | method | eve | steps | training, s | category, s |"
    assert lines[4] == (
        "| fewshot-5 | official | ActorsNeRF | "
        "26.00 ± 1.41 / 0.9200 ± 0.0141 / 35.0 ± 7.1 | 500 | 100 | 2,160 |"
    )
    assert lines[5] == "| fewshot-5 | official | HumanNeRF | 24.00 / 0.9500 / - | 450 | 100 | - |"


def test_every_number_is_a_line(table: Table) -> None:
    lines = list(csv.DictReader(comma_separated(table).splitlines()))
    assert len(lines) == 2 * 3 + 2 * 2  # an only actor is also the mean; one LPIPS is missing
    first = lines[0]
    assert (first["method"], first["metric"], float(first["value"])) == ("ActorsNeRF", "PSNR", 26.0)
    assert float(first["spread"]) == pytest.approx(2**0.5)
    assert (first["seeds"], first["budget"]) == ("2", "steps")


def test_each_budget_is_a_contest_of_its_own(table: Table) -> None:
    late = tuple(replace(row, budget="time", steps=(90,), seconds=20.0) for row in table.rows)
    both = replace(table, rows=(*table.rows, *late[1:]))
    lines = markdown(both).splitlines()
    assert lines[2].startswith("| setting | list | equal | method | eve | steps |")
    assert (
        lines[6] == "| fewshot-5 | official | time | HumanNeRF | 24.00 / 0.9500 / - | 90 | 20 | - |"
    )
    assert r"fewshot-5, equal time & HumanNeRF & \textbf{24.00} & \textbf{0.9500}" in latex(both)
    assert comma_separated(both).splitlines()[-1].endswith(",time")


def test_the_smaller_perceptual_error_is_the_better(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.91, 40.0))
    write((24.0, 0.90, 60.0), method="humannerf", pretrained_from=None)
    text = latex(make_table(gather([tmp_path]), "paper"))
    assert r"ActorsNeRF & \textbf{25.00} & \textbf{0.9100} & \textbf{40.0} \\" in text
    assert r"HumanNeRF & 24.00 & 0.9000 & 60.0 \\" in text


def test_latex_marks_the_best(table: Table) -> None:
    text = latex(table)
    ours = r"\textbf{26.00} $\pm$ 1.41 & 0.9200 $\pm$ 0.0141 & \textbf{35.0} $\pm$ 7.1"
    assert rf"fewshot-5 & ActorsNeRF & {ours} \\" in text
    assert r"fewshot-5 & HumanNeRF & 24.00 & \textbf{0.9500} & -- \\" in text
    assert text.count(r"\begin{tabular}{llrrr}") == 1


def test_differences_to_the_paper(write: "WriteResult", tmp_path: Path) -> None:
    real = {"dataset": "zju-mocap", "preset": "official", "step": 300_000}
    for actor in ("387", "393", "394"):
        write((27.0, 0.95, 50.0), actor=actor, **real)
    text = markdown(make_table(gather([tmp_path]), "paper"))
    assert "mean minus the paper's" in text
    assert "-0.52 / -0.0066 / +5.1" in text


def test_the_files(table: Table, tmp_path: Path) -> None:
    paths = write_table(tmp_path, "main", table, ("A note.",))
    assert [path.name for path in paths] == ["main.md", "main.csv", "main.tex"]
    assert paths[0].read_text().endswith("\nA note.\n")
