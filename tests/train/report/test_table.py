import json
from dataclasses import replace
from pathlib import Path

from actorsnerf_train.report.rows import SpeedReport
from actorsnerf_train.report.table import markdown, summary, write_tables


def test_json_and_markdown_hold_the_report(report: SpeedReport, tmp_path: Path) -> None:
    path = write_tables(tmp_path / "out", report)
    assert path.read_text() == markdown(report)
    record = json.loads((tmp_path / "out" / "report.json").read_text())
    assert record["schema_version"] == 1 and record["commit"] == "abc"
    assert record["actors"][0]["points"][2]["reference_largest"] == 0.05
    assert record["actors"][0]["training"][0]["worst_parameter"] == "a.b"


def test_the_table_says_what_was_measured(report: SpeedReport) -> None:
    text = markdown(report)
    assert "a processor (cpu), 1 of 2 cores" in text and "100 GFLOP/s float32" in text
    assert "The reference drew 5 % of the rays" in text
    assert "8 samples a ray, the person over 12.5 % of the pixels; 77 pixels drawn by the" in text
    assert "mean opacity 0.970 on the person's pixels, 24.50 dB" in text
    line = next(line for line in text.splitlines() if line.startswith("| `fast`"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == [
        "`fast`",
        "what fast does",
        "500 (450-550)",
        "200.0",
        "6400, 900 of 128000",
        "0.70",
        "-",
        "25.00",
        "0.9000",
        "-",
        "42.0",
        "0.255, 15.30",
    ]
    assert "(exact)" in next(line for line in text.splitlines() if line.startswith("| `exact`"))
    assert "**Use `fast`**" in text
    assert "* `reference`: `exact` is no slower and no further" in text
    assert "| picture | 160x120 | 250 | 1001 | 4321 |" in text
    assert "| pretrain | 4 of 32x32 | 128 | 1000 (900-1200) | 1000 (900-1200) | 7.5 |" in text
    assert "2.0e-05 (a.b)" in text
    assert "| deformation | 1000 (900-1200) | 1.000 + 1.000 | 640 |" in text


def test_the_terminal_hears_the_choice(report: SpeedReport) -> None:
    told = summary(report)
    assert told[0].startswith(
        "eve, ActorsNeRF: use fast (what fast does): 500 ms a frame, 200 times"
    )
    assert told[1] == "  nobody should use: reference"


def test_models_of_one_actor_stand_beside_each_other(report: SpeedReport) -> None:
    assert "beside each other" not in markdown(report)
    (eve,) = report.actors
    bare = replace(eve, method="ActorsNeRF, no pixel features")
    other = replace(eve, frames=("another frame",))
    text = markdown(replace(report, actors=(eve, bare, other)))
    table = text[text.index("## eve: its models beside each other") :]
    rows = [line for line in table.splitlines() if line.startswith("| ")][1:]
    assert len(rows) == 2
    cells = [cell.strip() for cell in rows[1].strip("|").split("|")]
    assert cells == [
        "ActorsNeRF, no pixel features",
        "7",
        "2000 (1800-2200)",
        "1.400 + 1.000",
        "6400, 900",
        "0.970",
        "25.00",
        "0.9000",
        "-",
        "`fast`, 500",
    ]
