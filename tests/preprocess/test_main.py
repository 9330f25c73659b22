import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from actorsnerf_preprocess import synthetic
from actorsnerf_preprocess.__main__ import main

WriteTree = Callable[..., Any]


@pytest.fixture
def raw(tmp_path: Path, write_zju: WriteTree) -> Path:
    write_zju(tmp_path / "raw" / "CoreView_377", frames=range(2), cameras=2)
    return tmp_path / "raw"


def arguments(*parts: object) -> list[str]:
    return [str(part) for part in parts]


def test_inspect_fits_one_screen_and_writes_nothing(
    raw: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(raw.rglob("*"))
    assert main(arguments("inspect", "--source", raw)) == 0
    out = capsys.readouterr().out
    assert len(out.splitlines()) < 40
    assert "classic tree, folders Camera_B<n>" in out
    assert "never run on an original archive" in out
    assert sorted(raw.rglob("*")) == before


def test_inspect_says_errors_with_its_exit_code(
    raw: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (raw / "CoreView_377" / "mask_cihp").rename(raw / "CoreView_377" / "m")
    assert main(arguments("inspect", "--source", raw)) == 2
    assert "error: masks: No masks" in capsys.readouterr().out


def test_prepare_ends_with_the_next_command(
    raw: Path, tmp_path: Path, tiny_body: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = arguments("prepare", "--source", raw, "--out", tmp_path / "out", "--workers", 1)
    command += ["--body-model", str(tiny_body)]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert "2 of 2 pictures stored" in out
    assert "pretraining in actorsnerf-zju" in out
    assert out.splitlines()[-1] == (
        f"next: python -m actorsnerf_datasets check {tmp_path / 'out' / 'CoreView_377.h5'}"
    )
    assert main(command) == 0
    assert "is there already, made with the same settings" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("extra", "sentence"),
    [
        (["--sequences", "999"], "error: .*has no sequence '999'; it has CoreView_377"),
        ([], "error: CoreView_377: ZJU-MoCap was fitted with SMPL's neutral model"),
        (["--body-model", "gone.pkl"], "error: gone.pkl: no such body-model file: register at"),
        (["--body-model", "gone.pkl", "--masks", "nowhere"], "error: "),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2_and_nothing_is_written(
    raw: Path,
    tmp_path: Path,
    extra: list[str],
    sentence: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    command = arguments("prepare", "--source", raw, "--out", out, "--workers", 1)
    assert main(command + extra) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert re.match(sentence, error)
    assert not out.exists()


def test_needed_files_are_listed_without_a_body_model(
    raw: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments("prepare", "--source", raw, "--list-needed")) == 0
    (raw / "CoreView_377" / "Camera_B1" / "000001.jpg").unlink()
    assert main(arguments("prepare", "--source", raw, "--list-needed")) == 2
    out = capsys.readouterr().out
    assert "pictures: 2 needed, 1 missing" in out
    assert "aistdancedb.ongaaccel.jp" in out


def test_a_dry_run_estimates_and_writes_nothing(
    raw: Path, tmp_path: Path, tiny_body: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = arguments("prepare", "--source", raw, "--out", tmp_path / "out", "--dry-run")
    assert main([*command, "--body-model", str(tiny_body), "--workers", "1"]) == 0
    assert "would store 2 pictures" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()


def test_one_bad_sequence_does_not_stop_the_others(
    raw: Path,
    tmp_path: Path,
    write_zju: WriteTree,
    tiny_body: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_zju(raw / "CoreView_313", frames=range(1), cameras=1)
    (raw / "CoreView_313" / "annots.npy").write_bytes(b"cut off")
    command = arguments("prepare", "--source", raw, "--out", tmp_path / "out", "--workers", 1)
    assert main([*command, "--body-model", str(tiny_body)]) == 2
    captured = capsys.readouterr()
    assert "CoreView_313/annots.npy" in captured.err
    assert (tmp_path / "out" / "CoreView_377.h5").is_file()


def test_inspect_goes_on_after_a_sequence_that_is_refused(
    raw: Path, write_zju: WriteTree, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("CoreView_313", "CoreView_386"):
        write_zju(raw / name, frames=range(1), cameras=1)
    (raw / "CoreView_313" / "annots.npy").write_bytes(b"cut off")
    assert main(arguments("inspect", "--source", raw)) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert re.match("error: .*CoreView_313/annots.npy", line)
    named = [line.split()[-1] for line in captured.out.splitlines() if line.startswith("sequence")]
    assert named == ["CoreView_377", "CoreView_386"]
    assert main(arguments("inspect", "--source", raw, "--sequences", "377", "386")) == 0


@pytest.mark.parametrize(
    "command", [("inspect",), ("prepare", "--dry-run"), ("prepare", "--list-needed")]
)
def test_names_of_held_out_txt_that_nobody_has_are_a_warning(
    command: tuple[str, ...],
    tmp_path: Path,
    write_zju: WriteTree,
    tiny_body: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("CoreView_anna", "CoreView_377"):
        write_zju(tmp_path / name, frames=range(2), cameras=2)
    (tmp_path / "held_out.txt").write_text("Anna\n")
    full = arguments(*command, "--source", tmp_path, "--body-model", tiny_body)
    assert main(full) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"warning: {tmp_path / 'held_out.txt'}: Anna is no actor or sequence")
    (tmp_path / "held_out.txt").write_text("anna\n")
    assert main([*full, "--sequences", "377"]) == 0
    assert capsys.readouterr().err == ""


def test_make_inspects_and_prepares_the_sequences_that_are_named() -> None:
    """`make` itself may not be there where the tests run."""
    lines = (Path(__file__).parents[2] / "Makefile").read_text().splitlines()
    for command in ("inspect", "prepare"):
        (line,) = [line for line in lines if f"actorsnerf_preprocess {command} " in line]
        assert "$(if $(SEQUENCES),--sequences $(SEQUENCES))" in line


def test_what_is_wrong_with_the_command_is_said_once(
    raw: Path, write_zju: WriteTree, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_zju(raw / "CoreView_386", frames=range(1), cameras=1)
    command = arguments("prepare", "--source", raw, "--out", tmp_path / "out", "--workers", 1)
    assert main([*command, "--body-model", "gone.pkl"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: gone.pkl: no such body-model file")


def test_output_that_nobody_reads_ends_the_command(raw: Path) -> None:
    command = [sys.executable, "-m", "actorsnerf_preprocess", "inspect", "--source", str(raw)]
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert done.returncode == 141
    assert done.stderr == ""


def test_synthetic_writes_what_its_preset_and_numbers_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []
    monkeypatch.setattr(
        synthetic, "write_zju_tree", lambda root, options, progress: written.append((root, options))
    )
    out = tmp_path / "my raw"
    command = arguments("synthetic", "--out", out, "--preset", "tiny", "--frames", 7, "--zoom", 1.5)
    assert main([*command, "--variant", "classic-21", "--fit-noise"]) == 0
    ((root, options),) = written
    assert root == out
    assert options == replace(
        synthetic.PRESETS["tiny"], frames=7, zoom=1.5, variant="classic-21", fit_noise=True
    )
    assert capsys.readouterr().out.splitlines() == [
        f"5 dancers in {out}",
        f"next: python -m actorsnerf_preprocess prepare --source '{out}' --out prepared",
    ]


def test_synthetic_writes_the_other_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = []
    monkeypatch.setattr(
        synthetic, "write_aist_tree", lambda root, options, progress: written.append(options)
    )
    command = arguments("synthetic", "--out", tmp_path, "--format", "aist", "--preset", "tiny")
    assert main(command) == 0
    assert written == [synthetic.PRESETS["tiny"]]


def test_synthetic_actors_are_drawn_where_the_source_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn: list[Path] = []
    monkeypatch.setattr(
        synthetic, "write_zju_tree", lambda root, options, progress: drawn.append(root)
    )
    source = tmp_path / "raw"
    assert main(arguments("prepare", "--source", source, "--dataset", "synthetic")) == 2
    assert drawn == [source]
    assert f"{source}: no such folder" in capsys.readouterr().err  # nothing was drawn in earnest
    assert main(arguments("prepare", "--source", source)) == 2
    assert drawn == [source]
