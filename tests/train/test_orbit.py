import dataclasses
import math

import numpy as np
import pytest

from actorsnerf_train.orbit import (
    FIELD_OF_VIEW,
    MARGIN,
    Stage,
    orbit_camera,
    orbit_intrinsics,
    stage_of,
)

UP = np.array([0.0, 1.0, 0.0])
FRONT = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def stage() -> Stage:
    return stage_of(np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.0, 0.0]]), UP, FRONT)


def test_stage_holds_the_joints(stage: Stage) -> None:
    assert stage.centre.tolist() == [0.25, 0.0, 0.0]
    assert stage.radius == pytest.approx(math.hypot(1.0, 0.25) + MARGIN)


@pytest.mark.parametrize(
    ("azimuth", "elevation"), [(0.0, 0.0), (90.0, 0.0), (200.0, 30.0), (10.0, -60.0)]
)
def test_camera_is_rigid_and_looks_at_the_centre(
    stage: Stage, azimuth: float, elevation: float
) -> None:
    matrix = orbit_camera(stage, azimuth, elevation)
    rotation = matrix[:3, :3]
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    seen = rotation @ stage.centre + matrix[:3, 3]
    distance = stage.radius / math.sin(math.radians(FIELD_OF_VIEW / 2))
    assert np.allclose(seen, [0, 0, distance])
    place = -rotation.T @ matrix[:3, 3]
    assert place[1] == pytest.approx(distance * math.sin(math.radians(elevation)))


def test_azimuth_starts_in_front_and_turns_counter_clockwise(stage: Stage) -> None:
    for azimuth, direction in ((0.0, [0, 0, 1]), (90.0, [1, 0, 0]), (180.0, [0, 0, -1])):
        matrix = orbit_camera(stage, azimuth, 0.0)
        place = -matrix[:3, :3].T @ matrix[:3, 3] - stage.centre
        assert np.allclose(place / np.linalg.norm(place), direction, atol=1e-12)


def test_up_is_up_in_the_picture(stage: Stage) -> None:
    matrix = orbit_camera(stage, 37.0, 20.0)
    assert (matrix[:3, :3] @ UP)[1] < 0  # OpenCV's y points down


@pytest.mark.parametrize("elevation", [0.0, 40.0])
def test_all_of_the_sphere_fits_the_picture(
    stage: Stage, elevation: float, rng: np.random.Generator
) -> None:
    directions = rng.normal(size=(2000, 3))
    points = stage.centre + stage.radius * directions / np.linalg.norm(
        directions, axis=1, keepdims=True
    )
    matrix, K = orbit_camera(stage, 12.0, elevation), orbit_intrinsics(64)
    seen = points @ matrix[:3, :3].T + matrix[:3, 3]
    pixels = (seen @ K.T)[:, :2] / seen[:, 2:]
    assert pixels.min() >= -0.5 and pixels.max() <= 63.5
    assert pixels.max() > 60  # and no smaller than needed


def test_a_front_that_points_up_still_gives_a_camera(stage: Stage) -> None:
    matrix = orbit_camera(dataclasses.replace(stage, front=UP), 0.0, 0.0)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)
    assert (matrix[:3, :3] @ UP)[1] == pytest.approx(-1.0)
