import dataclasses
import json
from pathlib import Path

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.result import (
    CameraRow,
    CurvePoint,
    Evaluation,
    ImageRow,
    MeanRow,
    StripLayout,
    StripRow,
)
from actorsnerf_train.result_file import markdown, read_result, write_result

RECORDED = Path(__file__).resolve().parents[2] / "benchmarks" / "results"


@pytest.fixture
def partial(evaluation: Evaluation) -> Evaluation:
    """Of part of a protocol, without LPIPS weights."""
    return dataclasses.replace(
        evaluation,
        list_name="auto",
        limited=True,
        missing=(("c1", 32),),
        seed=7,
        step=6,
        lpips_note="no weights",
        means=(MeanRow("paper", 27.714, 0.95904, None), MeanRow("box", 20.0, 0.8, 39.8)),
        per_camera=(CameraRow("c1", "paper", 27.714, 0.95904, None),),
        per_image=(ImageRow("c1", 30, "paper", 27.714, 0.95904, None, 0.5),),
    )


def test_a_result_comes_back_as_it_was(tmp_path: Path, partial: Evaluation) -> None:
    write_result(tmp_path / "result.json", partial)
    assert read_result(tmp_path / "result.json") == partial
    assert read_result(tmp_path) == partial
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_the_file_is_flat_and_documented(tmp_path: Path, partial: Evaluation) -> None:
    from actorsnerf_train import result

    write_result(tmp_path / "result.json", partial)
    record = json.loads((tmp_path / "result.json").read_text())
    assert (record["schema"], record["schema_version"]) == ("actorsnerf-result", 2)
    assert result.__doc__ is not None
    table = result.__doc__.split("====\n")[2]
    documented = [
        name.strip()
        for line in table.splitlines()
        if line and not line.startswith((" ", "="))
        for name in line[:20].split(",")
    ]
    assert list(record) == documented


def test_a_result_of_schema_1_has_neither_strip_nor_curve(
    tmp_path: Path, partial: Evaluation
) -> None:
    write_result(tmp_path / "result.json", partial)
    record = json.loads((tmp_path / "result.json").read_text())
    del record["strip"], record["curve"], record["category_seconds"]
    record["schema_version"] = 1
    (tmp_path / "result.json").write_text(json.dumps(record))
    assert read_result(tmp_path) == dataclasses.replace(partial, strip=None, curve=None)


def test_recorded_results_can_be_read() -> None:
    recorded = sorted(RECORDED.rglob("result.json"))
    assert len(recorded) >= 8
    assert all(read_result(path).setting is not None for path in recorded)


def test_strip_and_curve_come_back(tmp_path: Path, partial: Evaluation) -> None:
    layout = StripLayout((48, 64), 4, ("truth", "prediction"), (StripRow("c1", 30, 40, 64),))
    point = CurvePoint(10, 4.5, "box", 20.0, 0.8, None, (("c1", 30), ("c2", 32)))
    full = dataclasses.replace(partial, strip=layout, curve=(point,))
    write_result(tmp_path / "result.json", full)
    assert read_result(tmp_path) == full


def test_markdown_says_what_was_evaluated(partial: Evaluation) -> None:
    text = markdown(partial)
    assert "# eve: actorsnerf, fewshot-5 (auto list)" in text
    assert "encoder resnet18 (not pretrained); seed 7, step 6" in text
    assert "**A quick look" in text and "1 pictures of the protocol are missing" in text
    assert "LPIPS not computed: no weights" in text
    assert "| **all** | paper | 27.71 | 0.9590 | - |" in text
    assert "| **all** | box | 20.00 | 0.8000 | 39.80 |" in text
    assert "| c1 | paper | 27.71 | 0.9590 | - |" in text
    whole = dataclasses.replace(partial, limited=False, missing=(), lpips_note=None)
    assert not any(word in markdown(whole) for word in ("quick look", "missing", "not computed"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not readable as JSON"),
        ("[]", "is no result of this program"),
        ('{"schema": "other"}', "is no result of this program"),
        ('{"schema": "actorsnerf-result", "schema_version": 3}', "has schema version 3, this prog"),
        ('{"schema": "actorsnerf-result", "schema_version": 1}', "has no actor, background"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "result.json").write_text(content)
    with pytest.raises(UserError, match=message):
        read_result(tmp_path)


def test_no_result_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"result\.json: no such result; make one: python -m"):
        read_result(tmp_path)
