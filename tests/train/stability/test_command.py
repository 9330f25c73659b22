from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from actorsnerf_train.__main__ import main
from actorsnerf_train.stability import command
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import Case
from actorsnerf_train.stability.cases_light import light_cases
from actorsnerf_train.stability.command import (
    StabilityOptions,
    UnstableError,
    hard_cases,
    run_stability,
)

if TYPE_CHECKING:
    from tests.train.conftest import People


def two_cases(bench: Bench) -> list[Case]:
    return light_cases()[:2]


def a_failure(bench: Bench) -> list[Case]:
    first = light_cases()[8]
    return [replace(first, bounds=replace(first.bounds, float32=0.0))]


def test_every_named_case_is_there(bench: Bench) -> None:
    cases = hard_cases(bench)
    names = " / ".join(f"{case.group}: {case.name}" for case in cases)
    for word in (
        *("angle 0", "1e-8", "pi - 1e-6", "beyond 2 pi", "collapsed", "hands clasped"),
        *("upside-down", "crouching", "splits", "rest joints times -1", "fastest frame"),
        *("rows of zeros", "threshold", "corners", "straight down", "in a face", "along an edge"),
        *("camera inside", "behind the camera", "one-pixel", "border", "camera on a vertex"),
        *("looking away", "empty masks", "full masks", "constant", "saturated", "density 1e+06"),
        *("1e+04 m away", "centimetres", "large picture", "no valid ray"),
    ):
        assert word in names, word
    assert len({(case.group, case.name, case.measured) for case in cases}) == len(cases)


def test_the_table_of_a_checkpoint_lies_in_its_folder(
    fewshot_run: Path, people: "People", monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(command, "hard_cases", two_cases)
    told = run_stability(StabilityOptions(fewshot_run, people.eve, poses=3))
    assert told[0] == "3 hard cases, 0 out of bounds"
    text = (fewshot_run / "stability" / "stability.md").read_text()
    assert "on actor eve" in text
    assert "not run: add --long" in text


def test_a_failure_still_writes_the_table(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(command, "hard_cases", a_failure)
    with pytest.raises(UnstableError, match="failed: compositing"):
        run_stability(StabilityOptions(out=tmp_path, preset="tiny", poses=3))
    assert "**fails**" in (tmp_path / "stability.md").read_text()


def test_exit_statuses(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["stability", "--preset", "tiny", "--poses", "3", "--out", str(tmp_path)]
    monkeypatch.setattr(command, "hard_cases", a_failure)
    assert main(words) == 1
    assert "failed: compositing" in capsys.readouterr().out
    monkeypatch.setattr(command, "hard_cases", two_cases)
    assert main(words) == 0
    assert f"table: {tmp_path / 'stability.md'}" in capsys.readouterr().out
    assert main([*words, "--run", str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err.startswith("error: ")
