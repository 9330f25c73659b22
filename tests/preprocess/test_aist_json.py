import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_preprocess.aist_json import read_camera_entries
from actorsnerf_preprocess.source import SourceError


def camera(name: str = "c01") -> dict[str, Any]:
    return {
        "name": name,
        "size": [1920, 1080],
        "matrix": [[1600.0, 0, 960], [0, 1600.0, 540], [0, 0, 1]],
        "rotation": [0.0, np.pi / 2, 0.0],
        "translation": [1.0, 2.0, 500.0],
        "distortions": [-0.1, 0, 0, 0, 0],
        "error": "unknown keys do not matter",
    }


def written(folder: Path, content: object) -> Path:
    path = folder / "setting1.json"
    path.write_text(json.dumps(content))
    return path


def test_numbers_are_read_by_hand(tmp_path: Path) -> None:
    (entry,) = read_camera_entries(written(tmp_path, [camera()]))
    assert (entry.name, entry.index, entry.size) == ("c01", 0, (1920, 1080))
    # A quarter turn about y sends z to x.
    np.testing.assert_allclose(entry.R @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    assert entry.translation.tolist() == [1.0, 2.0, 500.0]
    assert entry.distortion.tolist() == [-0.1, 0, 0, 0, 0]


def test_nested_vectors_and_short_distortions_are_accepted(tmp_path: Path) -> None:
    loose = camera() | {"rotation": [[0.0], [0.0], [0.0]], "distortions": [[-0.1, 0.2, 0.0, 0.0]]}
    (entry,) = read_camera_entries(written(tmp_path, [loose]))
    assert np.array_equal(entry.R, np.eye(3))
    assert entry.distortion.tolist() == [-0.1, 0.2, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("matrix"), "camera c01: has no entry matrix"),
        (lambda c: c.update(translation=[1.0, 2.0]), r"translation: shape \(2,\), expected \(3,\)"),
        (lambda c: c.update(translation=[1, float("nan"), 2]), "translation: .* not finite"),
        (lambda c: c.update(rotation=["a", "b", "c"]), "rotation: is no array of numbers"),
        (lambda c: c.update(distortions=[0.0] * 8), "8 numbers, expected at most 5"),
        (lambda c: c["matrix"][0].__setitem__(0, -1600.0), "focal lengths -1600"),
        (lambda c: c["matrix"][0].__setitem__(2, 4000.0), "do not belong to a 1920 x 1080"),
    ],
)
def test_a_wrong_camera_is_named(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    wrong = camera()
    change(wrong)
    with pytest.raises(SourceError, match=message):
        read_camera_entries(written(tmp_path, [wrong]))


def test_a_file_that_is_no_list_of_cameras_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no such camera setting"):
        read_camera_entries(tmp_path / "setting9.json")
    with pytest.raises(SourceError, match="expected a list of cameras, found dict"):
        read_camera_entries(written(tmp_path, {"c01": camera()}))
    with pytest.raises(SourceError, match=r"two cameras share a name \(c01, c01\)"):
        read_camera_entries(written(tmp_path, [camera(), camera()]))
    (tmp_path / "setting1.json").write_text('[{"name": "c01"')
    with pytest.raises(SourceError, match="cannot be read as json"):
        read_camera_entries(tmp_path / "setting1.json")
