import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import pytest
import safetensors.torch
import torch
from torch import Tensor

from actorsnerf_model.baked.actor import BakedActorData
from actorsnerf_model.baked.baking import BakeReport
from actorsnerf_model.baked.file import (
    FORMAT,
    FORMAT_VERSION,
    BakedFileError,
    read_baked,
    write_baked,
)

CPU = torch.device("cpu")
Bake = Callable[[float], tuple[BakedActorData, BakeReport]]


def same(first: object, second: object) -> bool:
    """Equal to the bit, all the way down."""
    if isinstance(first, Tensor):
        assert isinstance(second, Tensor)
        return first.dtype == second.dtype and torch.equal(first, second)
    if dataclasses.is_dataclass(first):
        names = [field.name for field in dataclasses.fields(first)]
        return all(same(getattr(first, name), getattr(second, name)) for name in names)
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(map(same, first, second))
    return first == second


@pytest.fixture
def data(baked_at: Bake) -> BakedActorData:
    return baked_at(0.08)[0]


def test_what_is_read_is_what_was_written(data: BakedActorData, tmp_path: Path) -> None:
    path = tmp_path / "actor.safetensors"
    write_baked(path, data, {"who": "eve"})
    file = read_baked(path, CPU)
    assert data.offsets is not None and file.data.offsets is not None
    assert same(file.data, data)
    assert file.record == {"who": "eve"}
    assert [entry.name for entry in tmp_path.iterdir()] == ["actor.safetensors"]
    still = dataclasses.replace(data, offsets=None)
    write_baked(path, still, {})
    assert same(read_baked(path, CPU).data, still)


def test_the_same_actor_gives_the_same_bytes(data: BakedActorData, tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_baked(tmp_path / f"{name}.safetensors", data, {"x": "1", "y": "2"})
    first, second = ((tmp_path / f"{name}.safetensors").read_bytes() for name in ("a", "b"))
    assert first[:8] == second[:8] and len(first) == len(second)
    assert first[-100000:] == second[-100000:]


@pytest.mark.parametrize(
    ("about", "message"),
    [
        (None, "is no baked actor .its format is None"),
        ({"format": "weights"}, "is no baked actor .its format is 'weights'"),
        (
            {"format": FORMAT, "format_version": str(FORMAT_VERSION + 1)},
            f"is a baked actor of version {FORMAT_VERSION + 1}, this program reads up to",
        ),
        (
            {"format": FORMAT, "format_version": "1", "numbers": json.dumps({"offsets": None})},
            "lacks a part of a baked actor .'canonical_joints'.: damaged file; bake it again",
        ),
    ],
)
def test_another_file_is_refused(
    about: dict[str, str] | None, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "other.safetensors"
    safetensors.torch.save_file({"a": torch.zeros(2)}, path, about)
    with pytest.raises(BakedFileError, match=message):
        read_baked(path, CPU)


def test_a_file_cut_short_is_refused(data: BakedActorData, tmp_path: Path) -> None:
    path = tmp_path / "actor.safetensors"
    write_baked(path, data, {})
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(BakedFileError, match="is not readable as safetensors"):
        read_baked(path, CPU)
    with pytest.raises(BakedFileError, match="no such file; bake an actor first"):
        read_baked(tmp_path / "none.safetensors", CPU)
