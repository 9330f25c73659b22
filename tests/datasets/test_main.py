import re
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from actorsnerf_datasets.__main__ import main


def test_check_says_what_it_found_and_exits_accordingly(
    sequence_path: Path, body_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(sequence_path), "--body-model", str(body_file)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"{sequence_path}: 0 errors, 1 warnings"
    broken = sequence_path.with_name("broken.h5")
    shutil.copy(sequence_path, broken)
    with h5py.File(broken, "r+") as file:
        file["cameras/R"][1] *= -1
    assert main(["check", str(broken), str(sequence_path)]) == 1
    out = capsys.readouterr().out
    assert f"{broken}: error: cameras/R: camera c02: R is left-handed" in out
    assert f"{sequence_path}: 0 errors, 1 warnings" in out


def test_a_file_without_findings_is_in_order(
    sequence_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with h5py.File(sequence_path, "r+") as file:
        del file["protocols"]
    assert main(["check", str(sequence_path)]) == 0
    expected = f"{sequence_path}: in order (3 cameras, 12 frames, 35 pictures)\n"
    assert capsys.readouterr().out == expected


def test_describe_with_and_without_a_sheet(
    sequence_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("cv2", reason="OpenCV, of the preprocess extra, draws")
    assert main(["describe", str(sequence_path)]) == 0
    assert main(["describe", str(sequence_path), "--contact-sheet", str(tmp_path / "a.png")]) == 0
    assert capsys.readouterr().out.endswith(f"drawn       {tmp_path / 'a.png'}\n")
    both = [str(sequence_path)] * 2
    assert main(["describe", *both, "--contact-sheet", str(tmp_path / "b.png")]) == 2
    assert "draws one file, but 2 are given" in capsys.readouterr().err


def test_bad_input_is_one_sentence_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in ("check", "describe"):
        assert main([command, str(tmp_path / "no.h5")]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert re.fullmatch(r"error: .*no\.h5: does not exist; .*\n", captured.err)


def test_the_module_runs_and_its_help_teaches() -> None:
    command = [sys.executable, "-m", "actorsnerf_datasets", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "describe prepared/CoreView_387.h5 --contact-sheet 387.png" in done.stdout
    assert subprocess.run(command[:-1], capture_output=True, check=False).returncode == 2
