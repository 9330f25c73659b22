from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_datasets.pickles import PickleError
from actorsnerf_preprocess.source import SourceError
from actorsnerf_preprocess.zju_annotations import read_annotations, world_up

ABOUT_X = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Image down (second row) is world -z here."""


def content(**changes: object) -> dict[str, Any]:
    """Annotations of two cameras and two frames, with entries of `cams` or `ims` replaced."""
    K = np.array([[1000.0, 0, 512], [0, 1001, 510], [0, 0, 1]])
    cams: dict[str, Any] = {
        "K": [K, K],
        "D": [np.array([[-0.2], [0.1], [0], [0], [0.01]])] * 2,
        "R": [np.eye(3), ABOUT_X],
        "T": [np.array([[0.0], [100.0], [3000.0]]), np.array([[0.0], [0], [2900.0]])],
    }
    ims: Any = [
        {"ims": [f"a/{f}.jpg", f"b/{f}.jpg"], "kpts2d": np.zeros((2, 25, 3))} for f in (0, 1)
    ]
    for key, value in changes.items():
        if key == "ims":
            ims = value
        else:
            cams[key] = value
    return {"cams": cams, "ims": ims}


def write(tmp_path: Path, value: object) -> Path:
    np.save(tmp_path / "annots.npy", np.asarray(value, object), allow_pickle=True)
    return tmp_path / "annots.npy"


def test_cameras_come_in_metres_and_five_coefficients(tmp_path: Path) -> None:
    found = read_annotations(write(tmp_path, content()))
    assert found.T.tolist() == [[0, 0.1, 3.0], [0, 0, 2.9]]
    assert found.distortion[0].tolist() == [-0.2, 0.1, 0, 0, 0.01]
    assert found.pictures == (("a/0.jpg", "b/0.jpg"), ("a/1.jpg", "b/1.jpg"))
    assert found.notes[0].startswith("Camera translations are millimetres")


def test_lists_are_read_like_arrays(tmp_path: Path) -> None:
    cams = {
        key: [np.asarray(v).tolist() for v in values] for key, values in content()["cams"].items()
    }
    lists = read_annotations(write(tmp_path, {**content(), "cams": cams}))
    arrays = read_annotations(write(tmp_path, content()))
    for name in ("K", "distortion", "R", "T"):
        assert np.array_equal(getattr(lists, name), getattr(arrays, name))


def test_metres_are_recognised_and_said(tmp_path: Path) -> None:
    found = read_annotations(write(tmp_path, content(T=[np.array([0, 0, 3.0])] * 2)))
    assert found.T.tolist() == [[0, 0, 3.0]] * 2
    assert "metres already" in found.notes[0]


def test_row_vectors_and_four_coefficients_are_padded(tmp_path: Path) -> None:
    found = read_annotations(write(tmp_path, content(D=[[1.0, 2, 3, 4], [[1, 2, 3, 4, 5]]])))
    assert found.distortion.tolist() == [[1, 2, 3, 4, 0], [1, 2, 3, 4, 5]]


def test_backslashes_become_slashes_and_are_noted(tmp_path: Path) -> None:
    ims = [{"ims": ["a\\0.jpg", "b\\0.jpg"]}]
    found = read_annotations(write(tmp_path, content(ims=ims)))
    assert found.pictures == (("a/0.jpg", "b/0.jpg"),)
    assert "Backslashes" in found.notes[1]


def test_no_pictures_and_no_distortion_are_noted(tmp_path: Path) -> None:
    found = read_annotations(write(tmp_path, content(ims=[], D=[np.zeros(5)] * 2)))
    assert found.pictures == ()
    assert [f.sentence[:20] for f in found.findings] == [
        "Holds no picture pat",
        "All zero: the pictur",
    ]


LEFT_HANDED = np.diag([1.0, 1.0, -1.0])


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.zeros((3, 3)), r"annots.npy: expected a dictionary with 'cams'.*found a ndarray"),
        ({"cameras": 1}, r"found a dictionary with \['cameras'\]"),
        ({"cams": {"K": []}}, r"'cams' has no D, R, T"),
        (content(T=[np.zeros(3)]), r"different numbers of cameras: .*'T': 1"),
        (content(K=[np.eye(3), np.eye(2)]), r"cams/K does not hold numbers of shape \(3, 3\)"),
        (
            content(K=[np.eye(3), np.full((3, 3), np.nan)]),
            r"cams/K of camera index 1 is not finite",
        ),
        (content(D=[np.zeros(3)] * 2), r"cams/D has \[3\] numbers per camera, expected 5"),
        (content(R=[np.eye(3), 2 * np.eye(3)]), r"camera index 1 is not a rotation.*by 3"),
        (content(R=[np.eye(3), LEFT_HANDED]), r"camera index 1 is left-handed"),
        (content(K=[np.diag([-1.0, 1, 1])] * 2), r"has focal lengths \[-1.0, 1.0\]"),
        (content(T=[np.array([0, 0, 50.0])] * 2), r"50 units .* neither millimetres .* nor metres"),
        (content(ims=[{"ims": ["a"]}]), r"ims\[0\] lists 1 pictures, but 'cams' has 2 cameras"),
        (content(ims=["a", "b"]), r"ims\[0\] has no list 'ims' of picture paths, found a str"),
    ],
)
def test_what_cannot_be_right_is_refused(tmp_path: Path, value: object, message: str) -> None:
    with pytest.raises(SourceError, match=message):
        read_annotations(write(tmp_path, value))


def test_a_hostile_pickle_is_refused(tmp_path: Path) -> None:
    class Hostile:
        def __reduce__(self) -> tuple[Any, ...]:
            return (print, ("executed",))

    with pytest.raises(PickleError, match=r"names builtins.print"):
        read_annotations(write(tmp_path, {"cams": Hostile()}))


def test_up_is_minus_the_mean_of_the_image_down_directions() -> None:
    assert world_up(np.stack([ABOUT_X])).tolist() == [0, 0, 1]
    tilted = np.array([[1.0, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]])
    mirrored = np.array([[1.0, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
    assert np.allclose(world_up(np.stack([tilted, mirrored])), [0, -1, 0])
    with pytest.raises(SourceError, match="up is unknown"):
        world_up(np.stack([np.eye(3), np.diag([1.0, -1, -1])]))
