import numpy as np
import pytest

from actorsnerf_datasets import body_model
from actorsnerf_datasets.body_model import BodyModel
from actorsnerf_datasets.cameras import camera_from_world, project
from actorsnerf_datasets.conventions import (
    aist_from_metres,
    easymocap_from_standard,
    folded_root,
    metres_from_aist,
    opengl_from_opencv,
    standard_from_easymocap,
    standard_from_world_from_body,
    world_from_body,
)
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.types import Float64


def _moved(matrix: Float64, points: Float64) -> Float64:
    moved: Float64 = points @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


@pytest.fixture
def vectors(rng: np.random.Generator) -> tuple[Float64, Float64, Float64]:
    """Fifty rotations, translations and rest pelvises."""
    return rng.normal(size=(50, 3)) * 2, rng.normal(size=(50, 3)), rng.normal(size=(50, 3))


def test_easymocap_and_standard_move_vertices_alike(
    vectors: tuple[Float64, Float64, Float64], rng: np.random.Generator
) -> None:
    orient, transl, j0 = vectors
    points = rng.normal(size=(10, 3))
    Rh, Th = easymocap_from_standard(orient, transl, j0)
    for index in range(len(orient)):
        R = matrix_from_axis_angle(orient[index])
        standard = (points - j0[index]) @ R.T + j0[index] + transl[index]
        easymocap = points @ matrix_from_axis_angle(Rh[index]).T + Th[index]
        folded = _moved(world_from_body(orient[index], transl[index], j0[index]), points)
        np.testing.assert_allclose(easymocap, standard, atol=1e-13)
        np.testing.assert_allclose(folded, standard, atol=1e-13)


def test_round_trips_are_exact(vectors: tuple[Float64, Float64, Float64]) -> None:
    orient, transl, j0 = vectors
    back = standard_from_easymocap(*easymocap_from_standard(orient, transl, j0), j0)
    np.testing.assert_allclose(back[0], orient, atol=0)
    np.testing.assert_allclose(back[1], transl, atol=1e-14)
    again = standard_from_world_from_body(world_from_body(orient, transl, j0), j0)
    np.testing.assert_allclose(again[1], transl, atol=1e-13)
    np.testing.assert_allclose(
        matrix_from_axis_angle(again[0]), matrix_from_axis_angle(orient), atol=1e-13
    )
    np.testing.assert_allclose(
        aist_from_metres(metres_from_aist(transl, 93.7), 93.7), transl, atol=1e-15
    )


def test_the_pelvis_term_by_hand() -> None:
    upside_down, j0 = np.array([np.pi, 0.0, 0.0]), np.array([0.0, -0.22, 0.03])
    _, Th = easymocap_from_standard(upside_down, np.zeros(3), j0)
    np.testing.assert_allclose(Th, [0.0, -0.44, 0.06], atol=1e-15)


def test_a_folded_root_poses_the_same_body(body: BodyModel, rng: np.random.Generator) -> None:
    betas, pose = rng.normal(size=10), rng.normal(size=(24, 3)) * 0.3
    Rh, Th = rng.normal(size=3), rng.normal(size=3)
    posed = body_model.pose(body, betas, pose)
    expected = posed.vertices @ matrix_from_axis_angle(Rh).T + Th
    j0 = posed.rest_joints[0]
    rootless = np.concatenate([np.zeros((1, 3)), pose[1:]])
    Rh_total, Th_total = folded_root(Rh, Th, pose[0], j0)
    vertices = body_model.pose(body, betas, rootless).vertices
    found = vertices @ matrix_from_axis_angle(Rh_total).T + Th_total
    np.testing.assert_allclose(found, expected, atol=1e-13)


def test_aist_in_metres_projects_to_the_same_pixels(
    body: BodyModel, rng: np.random.Generator
) -> None:
    scaling, pose = 91.3, rng.normal(size=(24, 3)) * 0.3
    centimetres = rng.normal(size=3) * 30
    K = np.array([[1600.0, 0, 960], [0, 1600, 540], [0, 0, 1]])
    R, T = matrix_from_axis_angle(rng.normal(size=3)), np.array([3.0, -80.0, 500.0])
    as_found = scaling * body_model.pose(body, np.zeros(10), pose).vertices + centimetres
    posed = body_model.pose(body, np.zeros(10), np.concatenate([np.zeros((1, 3)), pose[1:]]))
    transl = metres_from_aist(centimetres, scaling)
    world = _moved(world_from_body(pose[0], transl, posed.rest_joints[0]), posed.vertices)
    before = project(as_found, K, camera_from_world(R, T)).pixels
    after = project(world, K, camera_from_world(R, metres_from_aist(T, scaling))).pixels
    np.testing.assert_allclose(after, before, atol=1e-9)


def test_opengl_cameras_look_backward() -> None:
    pose = opengl_from_opencv(np.eye(4))
    np.testing.assert_array_equal(pose @ [0.0, 0.0, -1.0, 1.0], [0.0, 0.0, 1.0, 1.0])
    np.testing.assert_array_equal(pose @ [0.0, 1.0, 0.0, 1.0], [0.0, -1.0, 0.0, 1.0])
