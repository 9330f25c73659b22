from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.errors import BodyModelError, LayoutError


def _lines(path: Path, body_model: Path | None = None) -> list[str]:
    return [f"{f.severity}: {f.entry}: {f.sentence}" for f in check_sequence(path, body_model)]


KNOWN = "warning: protocols/generic: 1 of the 16 pictures it uses are not there or not usable"


def test_a_good_file_is_in_order_with_its_body_model(sequence_path: Path, body_file: Path) -> None:
    assert _lines(sequence_path, body_file) == [KNOWN]


def _replace(name: str, change: Callable[[np.ndarray], object]) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        value = change(file[name][:])
        del file[name]
        file[name] = value

    return edit


def _delete(name: str) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        del file[name]

    return edit


def _delete_attribute(name: str) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        del file.attrs[name]

    return edit


FAULTS: list[tuple[str, Callable[[h5py.File], None], str]] = [
    (
        "dtype",
        _replace("fits/transl", np.float32),
        "fits/transl: has dtype float32, expected float64",
    ),
    ("shape", _replace("cameras/T", lambda T: T[:, :2]), "cameras/T: has shape (3, 2), but axis 3"),
    ("axes", _replace("cameras/K", lambda K: K.reshape(3, 9)), "expected axes (C, 3, 3)"),
    ("missing", _delete("pictures/valid"), "pictures/valid: is missing"),
    ("attribute", _delete_attribute("world_up"), "world_up: the attribute is missing"),
    ("protocol", _delete("protocols/generic/evaluation_cameras"), "has no evaluation_cameras"),
    ("nan", _replace("fits/betas", lambda b: b * np.nan), "fits/betas: has NaN or infinity in"),
    ("mirrored", _replace("cameras/R", lambda R: -R), "R is left-handed"),
    ("sheared", _replace("cameras/R", lambda R: R * [1, 1, 0.9]), "R deviates from orthonormal by"),
    ("units", _replace("cameras/T", lambda T: T * 1000), "are the units of the camera and of"),
    ("pose", _replace("fits/body_pose", lambda p: p * 1.1), "fits/posed_joints: up to"),
    ("orient", _replace("fits/global_orient", lambda g: g + 0.1), "fits/world_from_body: up to"),
    ("order", _replace("frames/number", lambda n: n[::-1]), "not strictly ascending"),
    ("frames", _replace("frames/number", lambda n: n + 50), "names frames that are not there: 100"),
    ("digest", _replace("fits/transl", np.copy), "fits/transl: has no attribute 'sha256'"),
]


@pytest.mark.parametrize(("edit", "sentence"), [f[1:] for f in FAULTS], ids=[f[0] for f in FAULTS])
def test_each_fault_is_found(
    sequence_path: Path, edit: Callable[[h5py.File], None], sentence: str
) -> None:
    with h5py.File(sequence_path, "r+") as file:
        edit(file)
    errors = [line for line in _lines(sequence_path) if line.startswith("error")]
    assert any(sentence in line for line in errors), errors


def test_with_wrong_geometry_masks_are_not_judged(sequence_path: Path) -> None:
    with h5py.File(sequence_path, "r+") as file:
        file["cameras/T"][:] *= 1000
    assert _lines(sequence_path)[-1] == (
        "note: pictures/alpha: not compared with the body, because of the errors in cameras or fits"
    )


def test_what_cannot_be_opened_is_refused(sequence_path: Path, tmp_path: Path) -> None:
    sequence_path.write_bytes(sequence_path.read_bytes()[:5000])
    with pytest.raises(LayoutError, match=r"cannot be opened as HDF5 .*truncated"):
        check_sequence(sequence_path)
    with pytest.raises(BodyModelError, match="no such body-model file"):
        check_sequence(sequence_path, tmp_path / "none.pkl")
