import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from actorsnerf_datasets import layout
from actorsnerf_datasets.reader import SequenceFile

README = Path(__file__).resolve().parents[2] / "datasets" / "README.md"


def test_the_examples_run(
    sequence_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(sequence_path, tmp_path / "sequence.h5")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL):
        exec(block, names)
    sequence = SequenceFile(sequence_path)
    picture = sequence.picture(1, 4)
    alpha, pixels, whole = (np.asarray(names[name]) for name in ("alpha", "pixels", "whole"))
    np.testing.assert_array_equal(np.asarray(names["rgb"]), picture.rgb)
    x, y = np.rint(pixels).astype(int).T
    assert (alpha[y, x] > 0).mean() > 0.9, "the joints project into the mask"
    assert whole.shape == (80, 80, 3)
    assert np.asarray(names["on_black"]).max() <= 255
    assert sorted(np.asarray(names["official"])) == [100, 101, 103, 104, 106]
    names["file"].close()  # type: ignore[attr-defined]
    names["sequence"].close()  # type: ignore[attr-defined]


def test_every_entry_and_attribute_is_specified() -> None:
    text = README.read_text()
    for entry in layout.ENTRIES:
        axes = ", ".join(entry.axes)
        assert f"| `{entry.path}` | {axes} | {entry.dtype} | {entry.meaning} |" in text
    for attribute in (*layout.ROOT_ATTRIBUTES, *layout.PROTOCOL_ATTRIBUTES):
        assert f"`{attribute}`" in text
    for name in layout.PROTOCOL_DATASETS:
        assert f"`{name}`" in text
    assert f"version {layout.LAYOUT_MAJOR}\n" in text
