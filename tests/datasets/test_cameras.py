import numpy as np
import pytest

from actorsnerf_datasets.cameras import (
    camera_centre,
    camera_from_world,
    cropped_intrinsics,
    distorted,
    project,
    project_distorted,
    scaled_intrinsics,
)
from actorsnerf_datasets.rotations import matrix_from_axis_angle

K = np.array([[500.0, 0.0, 255.5], [0.0, 480.0, 200.0], [0.0, 0.0, 1.0]])


def test_projection_by_hand() -> None:
    points = np.array([[0.0, 0.0, 2.0], [0.4, -0.2, 2.0], [0.1, 0.1, 0.0], [0.1, 0.1, -1.0]])
    found = project(points, K, np.eye(4))
    np.testing.assert_allclose(found.pixels[:2], [[255.5, 200.0], [355.5, 152.0]])
    assert np.isnan(found.pixels[2:]).all()
    assert found.in_front.tolist() == [True, True, False, False]
    assert found.depth.tolist() == [2.0, 2.0, 0.0, -1.0]


def test_the_centre_is_where_the_camera_sees_nothing(rng: np.random.Generator) -> None:
    R, T = matrix_from_axis_angle(rng.normal(size=(6, 3))), rng.normal(size=(6, 3))
    centre = camera_centre(R, T)
    seen = np.einsum("cij,cj->ci", camera_from_world(R, T), np.c_[centre, np.ones(6)])
    np.testing.assert_allclose(seen[:, :3], 0.0, atol=1e-15)


def test_a_scaled_camera_sees_scaled_pixels(rng: np.random.Generator) -> None:
    points = rng.normal(size=(40, 3)) + np.array([0, 0, 5])
    pixels = project(points, K, np.eye(4)).pixels
    half = project(points, scaled_intrinsics(K, 0.5), np.eye(4)).pixels
    np.testing.assert_allclose(half, (pixels + 0.5) * 0.5 - 0.5, atol=1e-12)
    both = project(points, scaled_intrinsics(K, (0.5, 2.0)), np.eye(4)).pixels
    np.testing.assert_allclose(both[:, 0], half[:, 0], atol=1e-12)
    np.testing.assert_allclose(both[:, 1], (pixels[:, 1] + 0.5) * 2 - 0.5, atol=1e-12)


def test_a_cropped_camera_sees_shifted_pixels(rng: np.random.Generator) -> None:
    points = rng.normal(size=(40, 3)) + np.array([0, 0, 5])
    cropped = project(points, cropped_intrinsics(K, (17, -3)), np.eye(4)).pixels
    expected = project(points, K, np.eye(4)).pixels - [17, -3]
    np.testing.assert_allclose(cropped, expected, atol=1e-12)
    assert K[0, 2] == 255.5, "the argument is left alone"


def test_distortion_by_hand() -> None:
    found = distorted(np.array([0.5, 0.0]), np.array([0.2, 0.1, 0.01, 0.02, 0.04]))
    radial = 1 + 0.2 * 0.25 + 0.1 * 0.25**2 + 0.04 * 0.25**3
    expected = [0.5 * radial + 0.02 * (0.25 + 2 * 0.25), 0.01 * 0.25]
    np.testing.assert_allclose(found, expected, rtol=1e-15)


def test_distorted_projection_equals_opencv(rng: np.random.Generator) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is the oracle")
    distortion = np.array([-0.3, 0.1, 0.002, -0.003, 0.02])
    vector, T = rng.normal(size=3) * 0.2, np.array([0.1, 0.2, 4.0])
    points = rng.normal(size=(100, 3))
    matrix = camera_from_world(matrix_from_axis_angle(vector), T)
    found = project_distorted(points, K, matrix, distortion).pixels
    expected, _ = cv2.projectPoints(points, vector, T, K, distortion)
    np.testing.assert_allclose(found, expected[:, 0], atol=1e-9)
