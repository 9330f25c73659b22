import errno
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import nn

from actorsnerf_train import checkpoint
from actorsnerf_train.checkpoint import (
    CheckpointError,
    CheckpointInfo,
    Origin,
    load_checkpoint,
    optimiser_tensors,
    prune_checkpoints,
    restore_optimiser,
    save_checkpoint,
    write_whole,
)

INFO = CheckpointInfo(
    format=checkpoint.FORMAT,
    format_version=checkpoint.FORMAT_VERSION,
    stage="pretrain",
    method="actorsnerf",
    step=40,
    seconds=1.5,
    configuration={"a": {"b": [1, 2.5, None]}},
    origin=Origin("resnet18", False, None, None, ()),
    data=(checkpoint.DataFile("x.h5", "s", "ann", "ab"),),
    setting=checkpoint.FewshotSetting("generic", "fewshot-5", "auto", "c", (1, 2), (2,)),
    generator="00ff",
    loss_scale={},
    versions={"torch": "2"},
    commit=None,
    tensors_sha256="",
)


def tensors() -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(5)
    return {
        "model/a.weight": torch.randn(3, 4, generator=generator).T,  # not contiguous
        "model/a.count": torch.tensor(7),
        "optimiser/a.weight/exp_avg": torch.randn(4, 3, generator=generator),
    }


def test_there_and_back(tmp_path: Path) -> None:
    path = save_checkpoint(tmp_path, INFO, tensors())
    for source in (tmp_path, path, path.with_suffix(".safetensors"), path.with_suffix("")):
        loaded = load_checkpoint(source)
        assert loaded.path == path
        assert replace(loaded.info, tensors_sha256="") == INFO
        for name, tensor in tensors().items():
            assert torch.equal(loaded.tensors[name], tensor)
    assert set(loaded.part("model")) == {"a.weight", "a.count"}
    assert list(tmp_path.rglob("*.part")) == []


def test_same_state_is_same_bytes(tmp_path: Path) -> None:
    one = save_checkpoint(tmp_path / "one", INFO, tensors())
    two = save_checkpoint(tmp_path / "two", INFO, tensors())
    for suffix in (".json", ".safetensors"):
        assert one.with_suffix(suffix).read_bytes() == two.with_suffix(suffix).read_bytes()


def test_a_write_that_fails_leaves_the_old_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_checkpoint(tmp_path, INFO, tensors())
    written = write_whole

    def fail_on_json(path: Path, content: bytes) -> None:
        if path.suffix == ".json":
            raise OSError("disk full")
        written(path, content)

    monkeypatch.setattr(checkpoint, "write_whole", fail_on_json)
    with pytest.raises(OSError, match="disk full"):
        save_checkpoint(tmp_path, replace(INFO, step=80), tensors())
    assert load_checkpoint(tmp_path).info.step == 40


def test_what_is_no_whole_checkpoint_is_told_apart(tmp_path: Path) -> None:
    baked = tmp_path / "actor.safetensors"
    baked.write_bytes(b"bricks")
    with pytest.raises(CheckpointError, match=r"is no checkpoint \(actor\.json is not beside it"):
        load_checkpoint(baked)
    save_checkpoint(tmp_path, INFO, tensors()).unlink()
    with pytest.raises(CheckpointError, match=r"latest: names step_000040\.json, which is not"):
        load_checkpoint(tmp_path)


def test_a_millionth_step_is_newer_than_the_one_before(tmp_path: Path) -> None:
    for step in (999_998, 999_999, 1_000_000):
        save_checkpoint(tmp_path, replace(INFO, step=step), tensors())
        prune_checkpoints(tmp_path, keep=2, keep_every=0)
    assert load_checkpoint(tmp_path).info.step == 1_000_000
    left = {path.stem for path in (tmp_path / checkpoint.FOLDER).glob("step_*")}
    assert left == {"step_999999", "step_1000000"}


def test_a_full_disk_is_named_and_keeps_no_half(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "file"
    write_whole(path, b"old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left on device") as refusal:
        write_whole(path, b"new")
    assert refusal.value.filename == str(path)
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [b"old"]


def test_damage_is_noticed(tmp_path: Path) -> None:
    path = save_checkpoint(tmp_path, INFO, tensors())
    numbers = path.with_suffix(".safetensors")
    content = bytearray(numbers.read_bytes())
    content[-1] ^= 1
    numbers.write_bytes(content)
    with pytest.raises(CheckpointError, match=r"step_000040\.safetensors: its SHA-256 is not"):
        load_checkpoint(tmp_path)
    numbers.unlink()
    with pytest.raises(CheckpointError, match=r"no such file, but step_000040\.json is there"):
        load_checkpoint(tmp_path)
    path.write_text("{")
    with pytest.raises(CheckpointError, match="is not readable as JSON"):
        load_checkpoint(tmp_path)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"format": "other"}, "is no checkpoint of this program"),
        ({"format_version": 99}, "has checkpoint format 99, this program reads up to 1"),
        ({"stage": "third"}, r"stage is 'third', expected one of \('pretrain', 'fewshot'\)"),
    ],
)
def test_foreign_json_is_refused(tmp_path: Path, change: dict[str, object], sentence: str) -> None:
    path = save_checkpoint(tmp_path, INFO, tensors())
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(CheckpointError, match=sentence):
        load_checkpoint(tmp_path)


def test_missing_checkpoints_are_explained(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="holds no checkpoint"):
        load_checkpoint(tmp_path)
    with pytest.raises(CheckpointError, match="no such run folder or checkpoint; pretrain first"):
        load_checkpoint(tmp_path / "absent")


def test_milestones_and_the_newest_are_kept(tmp_path: Path) -> None:
    for step in range(10, 71, 10):
        save_checkpoint(tmp_path, replace(INFO, step=step), tensors())
    prune_checkpoints(tmp_path, keep=2, keep_every=30)
    kept = sorted(path.stem for path in (tmp_path / "checkpoints").glob("*.json"))
    assert kept == ["step_000030", "step_000060", "step_000070"]
    prune_checkpoints(tmp_path, keep=1, keep_every=0)
    assert load_checkpoint(tmp_path).info.step == 70
    assert len(list((tmp_path / "checkpoints").glob("*.safetensors"))) == 1


def test_optimiser_memory_comes_back() -> None:
    def make() -> tuple[nn.Linear, torch.optim.Adam]:
        torch.manual_seed(3)
        layer = nn.Linear(4, 2)
        return layer, torch.optim.Adam(layer.parameters(), lr=0.1)

    def step(layer: nn.Linear, adam: torch.optim.Adam) -> None:
        adam.zero_grad()
        layer(torch.ones(1, 4)).square().sum().backward()
        adam.step()

    layer, adam = make()
    for _ in range(3):
        step(layer, adam)
    memory = optimiser_tensors(adam, dict(layer.named_parameters()))
    assert set(memory) == {
        f"{name}/{entry}"
        for name in ("weight", "bias")
        for entry in ("step", "exp_avg", "exp_avg_sq")
    }
    other, fresh = make()
    other.load_state_dict(layer.state_dict())
    restore_optimiser(fresh, dict(other.named_parameters()), memory)
    step(layer, adam)
    step(other, fresh)
    assert torch.equal(layer.weight, other.weight)
    assert torch.equal(layer.bias, other.bias)
