import dataclasses
import json
from pathlib import Path

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.result import CameraRow, Evaluation, ImageRow, MeanRow
from actorsnerf_train.result_file import markdown, read_result, write_result


@pytest.fixture
def evaluation() -> Evaluation:
    return Evaluation(
        method="actorsnerf",
        preset="tiny",
        actor="eve",
        sequence="eve-walks",
        dataset="synthetic",
        data_sha256="0" * 64,
        protocol="generic",
        setting="fewshot-5",
        list_name="auto",
        shots=5,
        supports=3,
        frames=(30, 32),
        cameras=("c1",),
        limited=True,
        missing=(("c1", 32),),
        background=(0.0, 0.0, 0.0),
        encoder="resnet18",
        encoder_pretrained=False,
        pretrained_from=None,
        seed=7,
        step=6,
        training_seconds=1.5,
        configuration={"schedule": {"steps": 6}},
        checkpoint="runs/eve",
        render_options={"samples": 8},
        lpips_note="no weights",
        machine={"device": "cpu", "cores": 2},
        commit=None,
        time="2026-01-02T03:04:05+00:00",
        seconds=2.5,
        render_seconds=0.5,
        means=(MeanRow("paper", 27.714, 0.95904, None), MeanRow("box", 20.0, 0.8, 39.8)),
        per_camera=(CameraRow("c1", "paper", 27.714, 0.95904, None),),
        per_image=(ImageRow("c1", 30, "paper", 27.714, 0.95904, None, 0.5),),
    )


def test_a_result_comes_back_as_it_was(tmp_path: Path, evaluation: Evaluation) -> None:
    write_result(tmp_path / "result.json", evaluation)
    assert read_result(tmp_path / "result.json") == evaluation
    assert read_result(tmp_path) == evaluation
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_the_file_is_flat_and_documented(tmp_path: Path, evaluation: Evaluation) -> None:
    from actorsnerf_train import result

    write_result(tmp_path / "result.json", evaluation)
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


def test_markdown_says_what_was_evaluated(evaluation: Evaluation) -> None:
    text = markdown(evaluation)
    assert "# eve: actorsnerf, fewshot-5 (auto list)" in text
    assert "encoder resnet18 (not pretrained); seed 7, step 6" in text
    assert "**A quick look" in text and "1 pictures of the protocol are missing" in text
    assert "LPIPS not computed: no weights" in text
    assert "| **all** | paper | 27.71 | 0.9590 | - |" in text
    assert "| **all** | box | 20.00 | 0.8000 | 39.80 |" in text
    assert "| c1 | paper | 27.71 | 0.9590 | - |" in text
    whole = dataclasses.replace(evaluation, limited=False, missing=(), lpips_note=None)
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
