import shlex
from pathlib import Path
from typing import Protocol

import pytest

from actorsnerf_train import __main__ as program
from actorsnerf_train.__main__ import main
from actorsnerf_train.fewshot import FewshotOptions
from actorsnerf_train.pretrain import PretrainOptions


class People(Protocol):
    eve: Path


def run(*words: str | Path) -> int:
    return main([str(word) for word in words])


@pytest.mark.parametrize("command", ["pretrain", "fewshot", "evaluate", "render"])
def test_every_command_teaches(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        run(command, "--help")
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert "usage: python -m actorsnerf_train" in text
    assert "(required)" in text


def test_the_program_lists_its_commands(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run("--help")
    text = capsys.readouterr().out
    for command in ("pretrain", "fewshot", "evaluate", "render"):
        assert command in text


def test_bad_input_is_one_sentence_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("pretrain", "--data", tmp_path, "--run", tmp_path / "run") == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {tmp_path}: holds no prepared file (*.h5)")
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_next_command_can_be_pasted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(program, "run_fewshot", lambda options: options.run / "it")
    folder, data = tmp_path / "my runs" / "eve", tmp_path / "eve's.h5"
    assert run("fewshot", "--data", data, "--from", "scratch", "--run", folder) == 0
    _, after, other = capsys.readouterr().out.splitlines()
    start = ["python", "-m", "actorsnerf_train"]
    out = str(folder / "evaluation")
    evaluation = ["evaluate", "--checkpoint", str(folder), "--data", str(data), "--out", out]
    assert shlex.split(after)[1:] == [*start, *evaluation]
    turntable = ["render", "--checkpoint", str(folder), "--out", str(folder / "turntable")]
    assert shlex.split(other)[1:] == [*start, *turntable]


TRAINING = ("pretrain", "--data", "no.h5", "--run", "run")
FITTING = ("fewshot", "--data", "no.h5", "--from", "scratch", "--run", "run")
EVALUATION = ("evaluate", "--checkpoint", "no", "--data", "no.h5", "--out", "out")
FILM = ("render", "--checkpoint", "no", "--out", "out")
REPORT = ("report", "no", "--data", "no.h5")
STABILITY = ("stability", "--run", "no")
TABLES = ("tables", "--out", "out", "--data", "no.h5")


@pytest.mark.parametrize(
    ("command", "option", "value"),
    [
        *((TRAINING, name, "0") for name in ("steps", "samples", "patches", "accumulation")),
        *((FITTING, name, "-1") for name in ("seed", "workers", "checkpoint-every")),
        *((FITTING, "rate-scale", value) for value in ("0", "-1", "nan", "inf")),
        *((EVALUATION, name, "0") for name in ("max-frames", "max-cameras", "samples")),
        *((EVALUATION, "stop-transmittance", value) for value in ("-0.1", "1")),
        *((FILM, name, "0") for name in ("pictures", "size", "samples", "fps")),
        *((FILM, name, "0") for name in ("mesh-resolution", "mesh-level")),
        *((FILM, "elevation", value) for value in ("90", "-90")),
        (REPORT, "samples", "0"),
        (STABILITY, "poses", "0"),
        *((TABLES, name, "0") for name in ("steps", "pretrain-steps", "max-frames")),
        (TABLES, "seeds", "-1"),
    ],
)
def test_a_number_that_means_nothing_is_refused_by_name(
    command: tuple[str, ...], option: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*command, f"--{option}", value) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: --{option} is {value}, expected ")
    assert error.count("\n") == 1


@pytest.mark.parametrize("command", [EVALUATION, FILM, REPORT, STABILITY, TABLES])
def test_several_processes_are_for_trainings(
    command: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    assert run(*command) == 2
    assert "only pretrain and fewshot share their work out" in capsys.readouterr().err


def test_tables_of_nothing_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*TABLES, "--seeds") == 2
    assert "error: --seeds names nothing" in capsys.readouterr().err


def test_a_disk_that_refuses_is_exit_code_2(
    people: People, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "taken"
    place.write_text("a file, not a folder")
    words = ("fewshot", "--data", people.eve, "--from", "scratch", "--run", place)
    assert run(*words, "--preset", "tiny", "--method", "humannerf", "--no-check") == 2
    error = capsys.readouterr().err
    assert f"error: {place}: File exists: make room, or name a place that can be" in error


def test_a_missing_category_checkpoint_is_exit_code_2(
    people: People, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("fewshot", "--data", people.eve, "--from", tmp_path / "no", "--run", tmp_path / "run")
    assert run(*words) == 2
    assert "error: " in (error := capsys.readouterr().err)
    assert "pretrain first" in error


def test_words_become_options(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[PretrainOptions | FewshotOptions] = []

    def pretrain(options: PretrainOptions) -> Path:
        seen.append(options)
        return Path("checkpoint.json")

    def fewshot(options: FewshotOptions) -> Path:
        seen.append(options)
        return Path("checkpoint.json")

    monkeypatch.setattr(program, "run_pretrain", pretrain)
    monkeypatch.setattr(program, "run_fewshot", fewshot)
    words = ("pretrain", "--data", "a.h5", "b", "--run", "r", "--preset", "tiny", "--steps", "5")
    assert run(*words, "--without", "deformation", "--rate-scale", "0.5", "--no-check") == 0
    fit = ("fewshot", "--data", "c.h5", "--from", "scratch", "--run", "s", "--list", "auto")
    assert run(*fit, "--lpips-vgg", "v.pth") == 0
    first, second = seen
    assert isinstance(first, PretrainOptions)
    assert first.data == (Path("a.h5"), Path("b"))
    assert (first.preset, first.without, first.use.check) == ("tiny", ("deformation",), False)
    assert (first.change.steps, first.change.rate_scale) == (5, 0.5)
    assert isinstance(second, FewshotOptions)
    assert (second.category, second.list, second.preset) == ("scratch", "auto", None)
    assert second.use.lpips.lpips_vgg == Path("v.pth")


def test_from_takes_a_folder_too(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[FewshotOptions] = []

    def fewshot(options: FewshotOptions) -> Path:
        seen.append(options)
        return Path("checkpoint.json")

    monkeypatch.setattr(program, "run_fewshot", fewshot)
    assert run("fewshot", "--data", "c.h5", "--from", "runs/all", "--run", "s") == 0
    assert seen[0].category == Path("runs/all")


def test_stopping_by_hand_says_how_to_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(options: PretrainOptions) -> Path:
        raise KeyboardInterrupt

    monkeypatch.setattr(program, "run_pretrain", stopped)
    assert run("pretrain", "--data", "a.h5", "--run", "r") == 130
    assert "the same command goes on from the last checkpoint" in capsys.readouterr().err


def test_what_begins_anew_does_not_promise_to_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(program, "run_evaluate", stopped)
    assert run(*EVALUATION) == 130
    assert capsys.readouterr().err == "stopped\n"


def test_only_one_process_of_torchrun_speaks(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(program, "run_pretrain", lambda options: Path("checkpoint.json"))
    monkeypatch.setenv("RANK", "1")
    assert run("pretrain", "--data", "a.h5", "--run", "r") == 0
    assert capsys.readouterr().out == ""
