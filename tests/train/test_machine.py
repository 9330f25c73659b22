import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from actorsnerf_train import machine
from actorsnerf_train.machine import program_commit, this_machine


def test_the_machine_is_named() -> None:
    found = this_machine(torch.device("cpu"))
    assert found.device == "cpu"
    assert found.cores >= 1
    assert found.threads == torch.get_num_threads()
    assert found.torch == torch.__version__
    assert found.processor


def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Callable[..., None]]:
    def git(*arguments: str) -> None:
        subprocess.run(["git", "-C", str(tmp_path), *arguments], check=True, capture_output=True)

    module = tmp_path / "machine.py"
    module.write_text("content\n")
    git("init", "-q")
    git("config", "user.email", "a@example.org")
    git("config", "user.name", "a")
    monkeypatch.setattr(machine, "__file__", str(module))
    return module, git


def test_commit_of_a_checkout_and_its_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, git = checkout(tmp_path, monkeypatch)
    git("add", "machine.py")
    git("commit", "-qm", "first")
    clean = program_commit()
    assert clean is not None and len(clean) == 40
    module.write_text("changed\n")
    assert program_commit() == clean + "+"


def test_a_copy_that_the_checkout_does_not_track_has_no_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, git = checkout(tmp_path, monkeypatch)
    git("commit", "-q", "--allow-empty", "-m", "first")
    assert program_commit() is None
