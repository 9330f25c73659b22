from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.renderer import Lighting, Mesh, MeshRenderer, Pinhole
from actorsnerf_preprocess.shots import Lens, Rig, rig_of, take

AMBIENT = Lighting((), 1.0)
K = np.array([[150.0, 0, 64.0], [0, 150.0, 60.0], [0, 0, 1]])
DISTORTION = np.array([-0.27, 0.10, 3e-4, -2e-4, -0.02])
SIZE = (128, 120)


@pytest.fixture(scope="module")
def renderer() -> Iterator[MeshRenderer]:
    with MeshRenderer() as made:
        yield made


def rig(distortion: Float64 = DISTORTION) -> Rig:
    backdrop = np.full((SIZE[1], SIZE[0], 3), 40, np.uint8)
    return rig_of(Lens(Pinhole(K, np.eye(3), np.zeros(3), SIZE), distortion), backdrop)


def panel(
    renderer: MeshRenderer, x: tuple[float, float], y: tuple[float, float], depth: float = 2.0
) -> Mesh:
    """A flat rectangle that faces the camera, subdivided so that its edges bend."""
    xs, ys = np.meshgrid(np.linspace(*x, 21), np.linspace(*y, 21))
    points = np.stack([xs.ravel(), ys.ravel(), np.full(441, depth)], 1).astype(np.float32)
    corner = (np.arange(20)[:, None] * 21 + np.arange(20)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 22, corner + 1], 1),
            np.stack([corner, corner + 21, corner + 22], 1),
        ]
    )
    paint = renderer.paint(np.full((4, 4, 3), 200, np.uint8), double_sided=True)
    normals = np.tile(np.array([0, 0, -1], np.float32), (441, 1))
    return Mesh(points, normals, faces, np.zeros((441, 2), np.float32), paint, 7)


def corners_seen(x: tuple[float, float], y: tuple[float, float]) -> Float64:
    points = np.array([[a, b, 2.0] for a in x for b in y])
    seen, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, DISTORTION)
    return np.asarray(seen[:, 0], np.float64)


def test_a_lens_puts_what_it_sees_where_opencv_projects_it(renderer: MeshRenderer) -> None:
    x, y = (0.15, 0.7), (-0.65, -0.1)
    shot = take(renderer, [panel(renderer, x, y)], rig(), AMBIENT)
    rows, columns = np.nonzero(shot.labels)
    found = np.array([[columns.min(), rows.min()], [columns.max(), rows.max()]])
    edge = np.linspace(0, 1, 50)
    outline = np.concatenate(
        [np.stack([x[0] + (x[1] - x[0]) * edge, np.full(50, side)], 1) for side in y]
        + [np.stack([np.full(50, side), y[0] + (y[1] - y[0]) * edge], 1) for side in x]
    )
    points = np.concatenate([outline, np.full((200, 1), 2.0)], 1)
    seen, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, DISTORTION)
    expected = np.array([seen[:, 0].min(axis=0), seen[:, 0].max(axis=0)])
    np.testing.assert_allclose(found, expected, atol=0.85)
    # Without the lens the far corner would be pixels away.
    straight = K[:2, :2] @ np.array([x[1], y[0]]) / 2.0 + K[:2, 2]
    assert np.abs(corners_seen(x, y) - straight).max(axis=1).min() > 2


def test_the_middle_of_coverage_is_where_the_pinhole_sees_it(renderer: MeshRenderer) -> None:
    """Within the 1/8 pixel that 2 x 2 samples leave; half a fine pixel, as GL's, would be 1/4."""
    shot = take(renderer, [panel(renderer, (-0.3, 0.25), (-0.2, 0.3))], rig(np.zeros(5)), AMBIENT)
    weights = shot.coverage.astype(np.float64) / shot.coverage.sum()
    middle = [(weights.sum(0) @ np.arange(128)), (weights.sum(1) @ np.arange(120))]
    expected = 150 * np.array([-0.025, 0.05]) / 2.0 + K[:2, 2]
    np.testing.assert_allclose(middle, expected, atol=0.126)
    area = shot.coverage.sum()
    assert area == pytest.approx(0.55 * 0.5 * 75**2, rel=0.02)


def test_edges_mix_person_and_backdrop_by_coverage(renderer: MeshRenderer) -> None:
    shot = take(renderer, [panel(renderer, (-0.3, 0.25), (-0.2, 0.3))], rig(), AMBIENT)
    inside, outside = shot.coverage == 1, shot.coverage == 0
    front = np.median(shot.rgb[inside], axis=0)
    assert np.abs(shot.rgb[inside].astype(float) - front).max() <= 2
    assert (shot.rgb[outside] == 40).all()
    share = shot.coverage[..., None]
    np.testing.assert_allclose(shot.rgb, share * front + (1 - share) * 40, atol=2)
    np.testing.assert_array_equal(shot.labels > 0, shot.coverage >= 0.5)
    assert set(np.unique(shot.labels)) == {0, 7}


def test_who_is_out_of_the_picture_leaves_the_backdrop(renderer: MeshRenderer) -> None:
    shot = take(renderer, [panel(renderer, (3.0, 3.2), (0.0, 0.1))], rig(), AMBIENT)
    assert (shot.rgb == 40).all() and not shot.labels.any() and shot.view is None


def test_a_person_at_the_edge_is_cut_there(renderer: MeshRenderer) -> None:
    shot = take(renderer, [panel(renderer, (0.4, 1.6), (-0.2, 0.2))], rig(), AMBIENT)
    assert (shot.coverage[55:65, -1] == 1).all()
