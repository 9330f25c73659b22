import numpy as np

from actorsnerf_datasets.types import Float32
from actorsnerf_preprocess.renderer import Drawing, Pinhole
from actorsnerf_preprocess.shots import View
from actorsnerf_preprocess.surface_share import COVER, seen_vertices, vertex_areas


def view(depth: Float32) -> View:
    K = np.array([[10.0, 0, 5.0], [0, 10.0, 5.0], [0, 0, 1]])
    empty = np.zeros(depth.shape, np.uint8)
    drawing = Drawing(np.zeros((*depth.shape, 3), np.uint8), depth, empty)
    return View(drawing, Pinhole(K, np.eye(3), np.zeros(3), depth.shape[::-1]))


def test_areas_are_shared_among_corners() -> None:
    """A unit right triangle beside one of half its area: 2/3 and 1/3, each over three corners."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.5, 0, 0]])
    areas = vertex_areas(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    np.testing.assert_allclose(areas, [1 / 3, 2 / 9, 1 / 3, 1 / 9])


def test_what_is_seen_faces_the_camera_and_has_only_clothes_before_it() -> None:
    depth = np.full((11, 11), 2.0, np.float32)
    depth[:, 8:] = 0.0
    towards, away, flat = [0.0, 0, -1], [0.0, 0, 1], [1.0, 0, 0]
    cases = [
        ([0.0, 0.0, 2.0], towards, True),
        ([0.0, 0.0, 2.0 + 0.9 * COVER], towards, True),
        ([0.0, 0.0, 2.0 + 1.1 * COVER], towards, False),
        ([0.0, 0.0, 2.0], away, False),
        ([0.0, 0.0, 2.0], flat, False),
        ([0.8, 0.0, 2.0], towards, False),  # pixel 9: nothing was drawn
        ([5.0, 0.0, 2.0], towards, False),  # outside the picture
        ([0.0, 0.0, -2.0], towards, False),  # behind the camera
    ]
    points, normals = (np.array([case[part] for case in cases]) for part in (0, 1))
    seen = seen_vertices(view(depth), points, normals)
    assert seen.tolist() == [case[2] for case in cases]
