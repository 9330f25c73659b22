from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_datasets.body_model import pose, rest
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_preprocess.source import SourceError
from actorsnerf_preprocess.zju_bodies import ReadFits, read_fits
from actorsnerf_preprocess.zju_choice import choose_fit

WriteTree = Callable[..., Any]


@pytest.fixture
def tree(tmp_path: Path, write_zju: WriteTree) -> Any:
    return write_zju(tmp_path / "CoreView_377", cameras=1, frames=range(12))


def read(tree: Any) -> ReadFits:
    return read_fits(
        tree.root, tree.frames, choose_fit(tree.root, tree.frames, tree.model), tree.model
    )


def test_the_standard_convention_gives_the_annotated_vertices(tree: Any) -> None:
    fits = read(tree).fits
    for frame in range(12):
        R = matrix_from_axis_angle(fits.global_orient[frame])
        axis_angles = np.concatenate([np.zeros((1, 3)), fits.body_pose[frame]])
        body = pose(tree.model, fits.betas[frame], axis_angles)
        j0 = fits.rest_joints[frame, 0]
        vertices = (body.vertices - j0) @ R.T + j0 + fits.transl[frame]
        assert np.abs(vertices - tree.world_vertices[frame]).max() < 1e-12
        assert np.abs(body.joints - fits.posed_joints[frame]).max() < 1e-12
        assert np.abs(body.vertices - fits.posed_vertices[frame]).max() < 1e-6


def test_the_actor_is_the_mean_shape_at_rest(tree: Any) -> None:
    found = read(tree)
    joints, vertices = rest(tree.model, found.fits.betas.mean(axis=0))
    assert np.allclose(found.shape.rest_joints, joints, atol=1e-12)
    assert np.allclose(found.shape.rest_vertices, vertices, atol=1e-6)


def test_missing_and_broken_fits_are_left_out_and_counted(tree: Any) -> None:
    (tree.root / "new_params" / "3.npy").unlink()
    path = tree.root / "new_params" / "5.npy"
    fit = np.load(path, allow_pickle=True).item()
    np.save(path, np.asarray({**fit, "Th": np.full((1, 3), np.nan)}), allow_pickle=True)
    found = read(tree)
    assert found.positions == (0, 1, 2, 4, 6, 7, 8, 9, 10, 11)
    assert len(found.fits.transl) == 10
    sentences = [finding.sentence for finding in found.findings]
    assert sentences[0] == "1 frames have no fit and are left out (first: [3])."
    assert "1 fits are unusable and left out" in sentences[1] and "'Th' is not" in sentences[1]


def test_vertices_that_do_not_fit_are_rebuilt_and_counted(tree: Any) -> None:
    path = tree.root / "new_vertices" / "2.npy"
    np.save(path, np.load(path) + 0.1)
    (tree.root / "new_vertices" / "7.npy").write_bytes(b"\x93NUMPY broken")
    found = read(tree)
    matrix = found.fits.world_from_body[2]
    world = found.fits.posed_vertices[2] @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.abs(world - tree.world_vertices[2]).max() < 1e-6
    sentences = [finding.sentence for finding in found.findings]
    assert sentences[0].startswith("1 files differ from the vertices rebuilt from new_params")
    assert sentences[1].startswith("1 frames have no readable vertices (first: [7])")


def test_many_files_of_another_fit_are_refused(tree: Any) -> None:
    for number in (0, 4, 9):
        path = tree.root / "new_vertices" / f"{number}.npy"
        np.save(path, np.load(path) + 0.1)
    with pytest.raises(
        SourceError, match=r"3 of 12 frames .*files of two fits mixed in one folder"
    ):
        read(tree)


def test_no_fit_of_the_asked_frames_is_refused_with_what_there_is(tree: Any) -> None:
    choice = choose_fit(tree.root, tree.frames, tree.model)
    with pytest.raises(SourceError, match=r"first asked: 50.npy.*12 files, 0.npy to 11.npy"):
        read_fits(tree.root, (50, 51), choice, tree.model)
