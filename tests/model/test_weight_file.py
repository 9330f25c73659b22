import pickle
from pathlib import Path

import pytest
import safetensors.torch
import torch

from actorsnerf_model.weight_file import WeightsError, read_weights


def test_both_formats_are_read(tmp_path: Path) -> None:
    state = {"a.weight": torch.arange(3.0), "count": torch.tensor(2)}
    safetensors.torch.save_file(state, tmp_path / "w.safetensors")
    torch.save({**state, "note": "no tensor"}, tmp_path / "w.pth")
    for name in ("w.safetensors", "w.pth"):
        found = read_weights(tmp_path / name)
        assert found.keys() == state.keys()
        assert all(torch.equal(found[key], state[key]) for key in state)


@pytest.mark.parametrize("name", ["w.safetensors", "w.pth"])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_part_of_a_file_is_a_sentence(tmp_path: Path, name: str, share: float) -> None:
    path, state = tmp_path / name, {"a": torch.rand(1000)}
    if name.endswith(".pth"):
        torch.save(state, path)
    else:
        safetensors.torch.save_file(state, path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(WeightsError, match=r"cannot be read as weights \(.*damaged, or not compl"):
        read_weights(path)


def test_code_in_a_file_is_not_run(tmp_path: Path) -> None:
    path, trace = tmp_path / "w.pth", tmp_path / "trace"

    class Touch:
        def __reduce__(self) -> tuple[object, tuple[Path]]:
            return Path.touch, (trace,)

    path.write_bytes(pickle.dumps({"a": Touch()}, protocol=2))
    with pytest.raises(WeightsError, match="cannot be read as weights"):
        read_weights(path)
    assert not trace.exists()


def test_something_else_than_weights_is_refused(tmp_path: Path) -> None:
    torch.save([torch.zeros(1)], tmp_path / "w.pth")
    with pytest.raises(WeightsError, match="holds a list, expected weights by name"):
        read_weights(tmp_path / "w.pth")
