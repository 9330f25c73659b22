import numpy as np
import pytest

from actorsnerf_preprocess.silhouettes import body_silhouette, person_box, project_points
from actorsnerf_preprocess.source import SourceCamera

CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ]
)


def camera(distortion: float = 0.0, distance: float = 5.0) -> SourceCamera:
    K = np.array([[100.0, 0, 59.5], [0, 100.0, 39.5], [0, 0, 1]])
    lens = np.array([distortion, 0, 0, 0, 0])
    return SourceCamera("c", 0, K, lens, np.eye(3), np.array([0, 0, distance]), (120, 80))


def test_a_cube_covers_the_square_of_its_near_side() -> None:
    # The near side, 2 m wide, is 4 m away: half a width is 100 * 1 / 4 = 25 pixels.
    drawn = body_silhouette(CUBE, FACES, camera()) > 0
    rows, columns = np.mgrid[:80, :120]
    inside = (np.abs(columns - 59.5) < 24.9) & (np.abs(rows - 39.5) < 24.9)
    outside = (np.abs(columns - 59.5) > 26.1) | (np.abs(rows - 39.5) > 26.1)
    assert drawn[inside].all() and not drawn[outside].any()


def test_the_side_of_the_triangles_does_not_matter() -> None:
    assert np.array_equal(
        body_silhouette(CUBE, FACES, camera()), body_silhouette(CUBE, FACES[:, ::-1], camera())
    )


def test_half_the_scale_is_half_the_picture() -> None:
    drawn = body_silhouette(CUBE, FACES, camera(), 0.5)
    assert drawn.shape == (40, 60)
    assert drawn.astype(bool).sum() == pytest.approx(25 * 25, rel=0.1)


def test_distortion_is_applied() -> None:
    # Barrel distortion (k1 < 0) pulls points to the middle: r (1 + k1 r^2) by hand.
    pixels, in_front = project_points(np.array([[1.0, 0, -1.0]]), camera(-0.4))
    r = 1 / 4
    assert in_front.all()
    np.testing.assert_allclose(pixels, [[59.5 + 100 * r * (1 - 0.4 * r * r), 39.5]])


def test_what_is_behind_the_camera_is_not_drawn() -> None:
    assert not body_silhouette(CUBE, FACES, camera(distance=-5.0)).any()
    pixels, in_front = project_points(np.array([[0, 0, -6.0], [0, 0, 0]]), camera())
    assert in_front.tolist() == [False, True] and np.isfinite(pixels).all()


def test_the_box_of_nothing_is_none_and_margins_stop_at_the_border() -> None:
    mask = np.zeros((10, 10), np.uint8)
    assert person_box(mask, 3) is None
    mask[0, 9] = 255
    assert person_box(mask, 3) == (6, 0, 10, 4)
