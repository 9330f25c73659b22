import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_datasets.body_model import load_body_model, pose
from actorsnerf_datasets.conventions import aist_from_metres, easymocap_from_standard
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_preprocess.aist_annotations import Motion
from actorsnerf_preprocess.aist_fits import fits_of_motion, world_joints


@pytest.fixture
def motion(rng: np.random.Generator) -> Motion:
    poses = rng.normal(0, 0.6, (5, 24, 3))
    poses[:, 0] *= 4  # Far from upright, where the pelvis term matters most.
    return Motion(poses, 93.5, rng.normal(0, 100, (5, 3)))


def test_vertices_are_those_of_the_documented_formula(motion: Motion, tiny_body: Path) -> None:
    model = load_body_model(tiny_body)
    frames = np.array([0, 2, 4])
    fits, _ = fits_of_motion(motion, frames, model)
    for row, frame in enumerate(frames):
        posed = pose(model, np.zeros(10), np.vstack([np.zeros((1, 3)), motion.poses[frame, 1:]]))
        R, j0 = matrix_from_axis_angle(motion.poses[frame, 0]), posed.rest_joints[0]
        centimetres = motion.scaling * ((posed.vertices - j0) @ R.T + j0)
        centimetres += motion.translation[frame]
        matrix = fits.world_from_body[row]
        world = fits.posed_vertices[row] @ matrix[:3, :3].T + matrix[:3, 3]
        # Vertices are stored in single precision.
        np.testing.assert_allclose(world, centimetres / motion.scaling, atol=1e-6)


def test_the_pelvis_does_not_move_with_the_root_rotation(motion: Motion, tiny_body: Path) -> None:
    fits, shape = fits_of_motion(motion, np.arange(5), load_body_model(tiny_body))
    pelvis = world_joints(fits)[:, 0]
    np.testing.assert_allclose(pelvis, shape.rest_joints[0] + fits.transl, atol=1e-12)
    # The released conversion, Th = t / s, would be off by R j0 - j0.
    _, Th = easymocap_from_standard(fits.global_orient, fits.transl, shape.rest_joints[0])
    assert np.linalg.norm(Th - fits.transl, axis=1).max() > 0.1


def test_translations_go_back_to_centimetres_exactly(motion: Motion, tiny_body: Path) -> None:
    fits, _ = fits_of_motion(motion, np.arange(5), load_body_model(tiny_body))
    back = aist_from_metres(fits.transl, motion.scaling)
    np.testing.assert_allclose(back, motion.translation, atol=1e-12)


def test_betas_are_zero_and_the_rest_is_the_models(motion: Motion, tiny_body: Path) -> None:
    model = load_body_model(tiny_body)
    fits, shape = fits_of_motion(motion, np.arange(2), model)
    assert not fits.betas.any() and fits.betas.shape == (2, 10)
    np.testing.assert_allclose(shape.rest_vertices, model.template, atol=1e-7)
    assert np.array_equal(fits.rest_joints[1], shape.rest_joints)


def test_projection_is_that_of_the_world_in_centimetres(write_aist: Any, tmp_path: Path) -> None:
    tree = write_aist(tmp_path)
    path = tree.root / "annotations" / "motions" / f"{tree.name}.pkl"
    entries = pickle.loads(path.read_bytes())
    motion = Motion(entries["smpl_poses"].reshape(-1, 24, 3), tree.scaling, entries["smpl_trans"])
    fits, _ = fits_of_motion(motion, np.arange(8), load_body_model(tree.body))
    np.testing.assert_allclose(world_joints(fits), tree.world_joints, atol=1e-9)
