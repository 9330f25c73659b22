import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import pytest
import torch
from torch import nn

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.checkpoint import load_checkpoint
from actorsnerf_train.distributed import Team, gathering, local_device, refuse_company, shared, team
from actorsnerf_train.options import Changes, Resources
from actorsnerf_train.pretrain import PretrainOptions, run_pretrain

CPU = torch.device("cpu")
STEP = Changes(steps=1, samples=8, patches=1)


class People(Protocol):
    ann: Path
    ben: Path


def test_two_processes_have_the_gradients_of_one_on_the_joint_batch(
    people: People, tmp_path: Path
) -> None:
    data = (people.ann, people.ben)
    alone = PretrainOptions(
        data,
        tmp_path / "alone",
        "tiny",
        change=replace(STEP, accumulation=2),
        use=Resources(workers=0, check=False),
    )
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # as the two have: sums in another order differ in the last digits
    expected = load_checkpoint(run_pretrain(alone)).part("optimiser")
    torch.set_num_threads(threads)
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
    # "--": torchrun would take our --run for an abbreviation of its own --run-path
    command += ["-m", "--", "actorsnerf_train", "pretrain", "--data", *map(str, data)]
    command += ["--run", str(tmp_path / "two"), "--preset", "tiny", "--no-check", "--workers", "0"]
    command += ["--steps", "1", "--samples", "8", "--patches", "1"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("checkpoint:") == 1  # one process speaks
    found = load_checkpoint(tmp_path / "two")
    assert found.info.configuration["processes"] == 2
    memory = found.part("optimiser")
    assert memory.keys() == expected.keys()
    for name, value in expected.items():
        torch.testing.assert_close(memory[name], value, rtol=1e-3, atol=1e-7, msg=name)
    assert memory["radiance.colour_out.weight/exp_avg"].abs().max() > 0


def test_alone_there_is_nothing_to_share(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    layer = nn.Linear(2, 1)
    with team(CPU) as together:
        assert (together.rank, together.processes, together.leads) == (0, 1, True)
        assert shared(layer, together) is layer
        together.wait()
        with gathering(layer, last=False):
            pass


def test_only_the_first_process_leads() -> None:
    assert Team(0, 3).leads
    assert not Team(2, 3).leads


def test_half_a_torchrun_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    monkeypatch.setenv("RANK", "0")
    for name in ("MASTER_ADDR", "MASTER_PORT"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(UserError, match="WORLD_SIZE is 2 but MASTER_ADDR, MASTER_PORT is not set"):
        team(CPU).__enter__()


def test_a_command_for_one_process_refuses_company(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORLD_SIZE", "1")
    refuse_company()
    monkeypatch.setenv("WORLD_SIZE", "2")
    with pytest.raises(UserError, match="WORLD_SIZE is 2, but only pretrain and fewshot"):
        refuse_company()


def test_devices_that_are_not_there_are_refused() -> None:
    assert local_device("cpu") == CPU
    with pytest.raises(UserError, match="--device nonsense: cannot be used here"):
        local_device("nonsense")
