from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_datasets.body_model import load_body_model
from actorsnerf_preprocess.source import SourceError
from actorsnerf_preprocess.zju_fits import (
    fit_file,
    read_fit,
    stored_vertices,
    world_vertices,
)

WriteTree = Callable[..., Any]


def save(path: Path, **changes: object) -> Path:
    fit: dict[str, object] = {
        "poses": np.zeros((1, 72)),
        "Rh": np.array([[0.1, 0.2, 0.3]]),
        "Th": np.ones((1, 3)),
        "shapes": np.zeros((1, 10)),
    }
    np.save(path, np.asarray({**fit, **changes}), allow_pickle=True)
    return path


def test_files_are_found_with_and_without_leading_zeros(tmp_path: Path) -> None:
    (tmp_path / "7.npy").touch()
    (tmp_path / "000008.npy").touch()
    assert fit_file(tmp_path, 7) == tmp_path / "7.npy"
    assert fit_file(tmp_path, 8) == tmp_path / "000008.npy"
    assert fit_file(tmp_path, 9) is None


def test_poses_of_69_numbers_are_given_a_root(tmp_path: Path) -> None:
    poses = np.arange(69.0)[None]
    fit = read_fit(save(tmp_path / "0.npy", poses=poses))
    assert fit.padded
    assert fit.pose[0].tolist() == [0, 0, 0]
    assert fit.pose[1].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"poses": np.zeros((1, 66))}, r"0.npy: entry 'poses' has 66 numbers, expected 72 or 69"),
        ({"Rh": np.array([[np.nan, 0, 0]])}, "entry 'Rh' is not finite"),
        ({"shapes": "tall"}, "entry 'shapes' does not hold numbers"),
    ],
)
def test_wrong_entries_are_named(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    with pytest.raises(SourceError, match=message):
        read_fit(save(tmp_path / "0.npy", **changes))


def test_a_missing_entry_is_named(tmp_path: Path) -> None:
    np.save(tmp_path / "0.npy", np.asarray({"poses": 1, "id": 0}), allow_pickle=True)
    with pytest.raises(SourceError, match=r"has no entry 'Rh'|entry 'poses' has 1 numbers"):
        read_fit(tmp_path / "0.npy")
    np.save(tmp_path / "0.npy", np.zeros(3))
    with pytest.raises(SourceError, match="expected a dictionary with poses, Rh, Th and shapes"):
        read_fit(tmp_path / "0.npy")


def test_rebuilt_vertices_are_those_of_the_file(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    tree = write_zju(tmp_path, frames=range(2), cameras=1)
    fit = read_fit(tmp_path / "new_params" / "1.npy")
    rebuilt = world_vertices(fit, tree.model, pose_blend=True)
    assert np.abs(rebuilt - tree.world_vertices[1]).max() < 1e-12


def test_a_root_inside_the_pose_is_the_same_as_one_outside(tmp_path: Path, tiny_body: Path) -> None:
    model = load_body_model(tiny_body)
    turn = np.array([0.3, -0.2, 0.9])
    pelvis = (model.joint_regressor @ model.template)[0]
    inside = np.zeros((1, 72))
    inside[0, :3] = turn
    a = read_fit(save(tmp_path / "a.npy", poses=inside, Rh=np.zeros(3), Th=np.zeros(3)))
    # R x + j0 - R j0: about the pelvis, as a root rotation is.
    outside = read_fit(save(tmp_path / "b.npy", Rh=turn, Th=np.zeros(3)))
    about_origin = world_vertices(outside, model, True)
    about_pelvis = world_vertices(a, model, True)
    shift = about_pelvis - about_origin
    assert np.abs(shift - shift[0]).max() < 1e-12
    regressed = model.joint_regressor @ about_pelvis
    assert np.abs(regressed[0] - pelvis).max() < 0.01


def test_vertices_of_another_body_are_refused(tmp_path: Path, tiny_body: Path) -> None:
    model = load_body_model(tiny_body)
    np.save(tmp_path / "0.npy", np.zeros((6890, 3), np.float32))
    with pytest.raises(SourceError, match="has 6890 vertices, but the body model has 192"):
        stored_vertices(tmp_path / "0.npy", model)
    np.save(tmp_path / "0.npy", np.asarray({}), allow_pickle=True)
    with pytest.raises(SourceError, match="expected an array of vertices"):
        stored_vertices(tmp_path / "0.npy", model)
    np.save(tmp_path / "0.npy", np.zeros(200))
    with pytest.raises(SourceError, match="expected an array of vertices"):
        stored_vertices(tmp_path / "0.npy", model)
