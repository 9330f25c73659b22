import numpy as np
import pytest

from actorsnerf_datasets.rotations import axis_angle_from_matrix, matrix_from_axis_angle


def test_a_quarter_turn_about_each_axis() -> None:
    turns = matrix_from_axis_angle(np.eye(3) * np.pi / 2)
    x, y, z = np.eye(3)
    np.testing.assert_allclose(turns[0] @ y, z, atol=1e-15)
    np.testing.assert_allclose(turns[1] @ z, x, atol=1e-15)
    np.testing.assert_allclose(turns[2] @ x, y, atol=1e-15)


@pytest.mark.parametrize("scale", [1e-200, 1e-12, 1e-4, 1.0, 3.0, 50.0])
def test_orthogonal_to_rounding_for_any_angle(rng: np.random.Generator, scale: float) -> None:
    matrix = matrix_from_axis_angle(rng.normal(size=(500, 3)) * scale)
    products = matrix @ np.swapaxes(matrix, -1, -2)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=2e-15)
    np.testing.assert_allclose(np.linalg.det(matrix), 1.0, atol=2e-15)


def test_equals_the_power_series(rng: np.random.Generator) -> None:
    for vector in rng.normal(size=(20, 3)):
        x, y, z = vector
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        term, series = np.eye(3), np.eye(3)
        for order in range(1, 60):
            term = term @ cross / order
            series = series + term
        np.testing.assert_allclose(matrix_from_axis_angle(vector), series, atol=1e-13)


def test_small_angles_keep_their_first_order() -> None:
    matrix = matrix_from_axis_angle(np.array([0.0, 0.0, 1e-9]))
    assert matrix[1, 0] == pytest.approx(1e-9, rel=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 0.5, 2.0, np.pi - 1e-7, np.pi])
def test_axis_angle_comes_back(rng: np.random.Generator, angle: float) -> None:
    axes = rng.normal(size=(200, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    found = axis_angle_from_matrix(matrix_from_axis_angle(axes * angle))
    either = np.minimum(abs(found - axes * angle), abs(found + axes * angle))
    difference = either if angle == np.pi else abs(found - axes * angle)
    assert difference.max() < 1e-14


def test_angles_beyond_pi_come_back_as_the_same_rotation(rng: np.random.Generator) -> None:
    matrix = matrix_from_axis_angle(rng.normal(size=(200, 3)) * 20)
    vectors = axis_angle_from_matrix(matrix)
    assert np.linalg.norm(vectors, axis=1).max() <= np.pi + 1e-15
    np.testing.assert_allclose(matrix_from_axis_angle(vectors), matrix, atol=1e-14)
