import json
import math
from pathlib import Path

import pytest

from actorsnerf_train.journal import CURVES, LOG, Entry, Journal, keep_log_until


def entry(step: int) -> Entry:
    return Entry(step, "ann", 0.5, 0.4, 0.01, 0.2, 0.9, math.nan, 0.25, 1.0, 3.0, 12.5)


def test_lines_curves_and_the_perceptual_terms_own_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Journal(tmp_path, "gradient_pyramid", 0, 4) as journal:
        for step in (1, 2):
            journal.advance()
            journal.record(entry(step))
    lines = [json.loads(line) for line in (tmp_path / LOG).read_text().splitlines()]
    assert [line["step"] for line in lines] == [1, 2]
    assert lines[0]["gradient_pyramid"] == 0.4
    assert lines[0]["alpha_outside"] is None
    assert lines[0]["seconds"] == 12.5
    assert not any("lpips" in line for line in lines)
    assert list((tmp_path / CURVES).glob("events.*"))
    assert "2/4" in capsys.readouterr().err


def test_a_resumed_log_has_no_step_twice(tmp_path: Path) -> None:
    with Journal(tmp_path, "lpips", 0, 6) as journal:
        for step in (2, 4, 5):
            journal.record(entry(step))
    (tmp_path / LOG).write_text((tmp_path / LOG).read_text() + '{"step": 6, "los')
    with Journal(tmp_path, "lpips", 4, 6) as journal:
        journal.record(entry(6))
    steps = [json.loads(line)["step"] for line in (tmp_path / LOG).read_text().splitlines()]
    assert steps == [2, 4, 6]


def test_a_silent_journal_writes_and_prints_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with Journal(None, "lpips", 0, 2) as journal:
        journal.advance()
        journal.record(entry(1))
        assert journal.seconds() >= 0
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().err == ""


def test_a_log_that_is_not_there_is_left_so(tmp_path: Path) -> None:
    keep_log_until(tmp_path / LOG, 3)
    assert list(tmp_path.iterdir()) == []
