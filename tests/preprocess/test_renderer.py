import itertools
import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.renderer import (
    Light,
    Lighting,
    Mesh,
    MeshRenderer,
    Paint,
    Pinhole,
)

SIZE = (60, 44)
K = np.array([[52.0, 0, 27.3], [0, 50.0, 20.6], [0, 0, 1]])


@pytest.fixture(scope="module")
def renderer() -> Iterator[MeshRenderer]:
    with MeshRenderer() as made:
        yield made


@pytest.fixture(scope="module")
def grey(renderer: MeshRenderer) -> Paint:
    return renderer.paint(np.full((4, 4, 3), 180, np.uint8), double_sided=True)


def quad(corners: Float64, paint: Paint, label: int = 1) -> Mesh:
    """Four corners in a ring, facing the camera at the origin."""
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    normals = np.tile(np.array([0, 0, -1], np.float32), (4, 1))
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    return Mesh(corners.astype(np.float32), normals, faces, uv, paint, label)


def rectangle(low: tuple[float, float], high: tuple[float, float], depth: float) -> Float64:
    """Corners, on a plane of one depth, that lie at given pixels of the camera `K`."""
    pixels = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    rays = np.concatenate([pixels, np.ones((4, 1))], axis=1) @ np.linalg.inv(K).T
    return rays * depth


def at_origin() -> Pinhole:
    return Pinhole(K, np.eye(3), np.zeros(3), SIZE)


def test_a_pixel_is_drawn_if_its_integer_centre_is_covered(
    renderer: MeshRenderer, grey: Paint
) -> None:
    """A rectangle from 9.8 to 19.2 covers the centres 10 to 19; half a pixel off it would not."""
    mesh = quad(rectangle((9.8, 5.7), (19.2, 12.3), 2.0), grey)
    labels = renderer.draw([mesh], at_origin(), None).labels
    expected = np.zeros(SIZE[::-1], np.uint8)
    expected[6:13, 10:20] = 1
    np.testing.assert_array_equal(labels, expected)


def test_depth_is_that_of_the_ray_through_the_integer_pixel(
    renderer: MeshRenderer, grey: Paint
) -> None:
    normal, offset = np.array([0.35, -0.25, 1.0]), 2.2
    corners = rectangle((4, 4), (54, 38), 1.0)
    corners *= (offset / (corners @ normal))[:, None]
    depth = renderer.draw([quad(corners, grey)], at_origin(), None).depth
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(K).T
    expected = offset / (rays @ normal)
    inside = depth > 0
    assert inside.sum() > 1500
    # A shift of a tenth of a pixel would be 1e-3 m here.
    assert np.abs(depth - expected)[inside].max() < 5e-5


def test_what_is_in_front_hides_what_is_behind_and_nothing_is_black(
    renderer: MeshRenderer, grey: Paint
) -> None:
    far = quad(rectangle((10, 10), (40, 30), 3.0), grey, 7)
    near = quad(rectangle((20, 5), (30, 20), 2.0), grey, 200)
    drawing = renderer.draw([near, far], at_origin(), None)
    assert drawing.labels[15, 25] == 200
    assert drawing.labels[25, 25] == 7
    assert drawing.labels[2, 2] == 0
    np.testing.assert_array_equal(drawing.rgb[drawing.labels > 0], 180)
    assert not drawing.rgb[drawing.labels == 0].any()
    np.testing.assert_allclose(drawing.depth[15, [5, 12, 25]], [0, 3, 2], atol=1e-4)


def test_of_meshes_at_the_same_depth_the_first_given_is_in_front(renderer: MeshRenderer) -> None:
    """Whatever their addresses in memory: else two runs draw different pictures."""
    corners = rectangle((10, 10), (40, 30), 2.0)
    paints = [renderer.paint(np.full((4, 4, 3), 20 + 20 * n, np.uint8), True) for n in range(8)]
    for first in range(8):
        order = [(first + step) % 8 for step in range(8)]
        meshes = [quad(corners, paints[number], 1 + number) for number in order]
        drawing = renderer.draw(meshes, at_origin(), None)
        assert drawing.labels[20, 20] == 1 + first
        assert drawing.rgb[20, 20, 0] == 20 + 20 * first


def test_lights_are_added_up_in_the_order_given(renderer: MeshRenderer, grey: Paint) -> None:
    """Two lights that cancel swallow a third that comes between them or before, by rounding.

    Nobody lights a scene so, but any three lights may round by their order.
    """
    mesh = quad(rectangle((10, 10), (40, 30), 2.0), grey)
    ahead = np.array([0.0, 0.0, 1.0])
    plus, minus, small = Light(ahead, 1e9), Light(ahead, -1e9), Light(ahead, np.pi)
    for _ in range(4):
        for order in itertools.permutations((plus, minus, small)):
            rgb = renderer.draw([mesh], at_origin(), Lighting(order, 0.0)).rgb
            assert (rgb[20, 20, 0] > 150) == (order[2] is small)


def test_without_labels_the_mask_is_the_same(renderer: MeshRenderer, grey: Paint) -> None:
    mesh = quad(rectangle((9.8, 5.7), (31.1, 29.3), 2.0), grey, 9)
    full = renderer.draw([mesh], at_origin(), None)
    quick = renderer.draw([mesh], at_origin(), None, labels=False)
    np.testing.assert_array_equal(quick.labels, full.labels > 0)
    np.testing.assert_array_equal(quick.rgb, full.rgb)


def test_the_camera_looks_where_opencvs_does(renderer: MeshRenderer, grey: Paint) -> None:
    """A moved and turned camera sees a small square where the projection formula says."""
    turn = 0.4
    R = np.array(
        [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
    ) @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    T = np.array([0.1, -0.2, 0.5])
    point = R.T @ (np.array([0.3, 0.2, 2.0]) - T)
    square = 0.03 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) @ R
    drawing = renderer.draw([quad(point + square, grey)], Pinhole(K, R, T, SIZE), None)
    rows, columns = np.nonzero(drawing.labels)
    expected = K @ [0.15, 0.1, 1.0]
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected[:2], atol=0.5)


def test_textures_lie_with_v_up(renderer: MeshRenderer) -> None:
    texture = np.zeros((8, 8, 3), np.uint8)
    texture[:4, :4] = (255, 0, 0)
    texture[4:, 4:] = (0, 0, 255)
    mesh = quad(rectangle((10, 10), (40, 40), 2.0), renderer.paint(texture, double_sided=True))
    rgb = renderer.draw([mesh], at_origin(), None).rgb
    assert rgb[15, 15].tolist() == [255, 0, 0]
    assert rgb[35, 35].tolist() == [0, 0, 255]
    assert rgb[15, 35].tolist() == [0, 0, 0]


def test_light_falls_on_what_faces_it(renderer: MeshRenderer, grey: Paint) -> None:
    mesh = quad(rectangle((10, 10), (40, 30), 2.0), grey)

    def brightness(direction: list[float]) -> int:
        lighting = Lighting((Light(np.array(direction, np.float64), np.pi),), 0.1)
        return int(renderer.draw([mesh], at_origin(), lighting).rgb[20, 20, 0])

    head_on, slanting, behind = (
        brightness([0, 0, 1]),
        brightness([0.8, 0, 0.6]),
        brightness([0, 0, -1]),
    )
    assert abs(head_on - 180) < 12
    assert head_on - 20 > slanting > behind + 20


def test_a_crop_shows_the_same_pixels(renderer: MeshRenderer, grey: Paint) -> None:
    mesh = quad(rectangle((9.8, 5.7), (31.1, 29.3), 2.0), grey, 9)
    whole = renderer.draw([mesh], at_origin(), None)
    part = renderer.draw([mesh], at_origin().cropped((4, 2, 24, 40)), None)
    np.testing.assert_array_equal(part.labels, whole.labels[2:40, 4:24])
    np.testing.assert_allclose(part.depth, whole.depth[2:40, 4:24], atol=1e-6)


def test_a_finer_view_keeps_pixel_edges() -> None:
    """The finer pixels' centres lie around the coarse one's: c to 2 c + 0.5."""
    fine = at_origin().finer(2)
    point = np.array([0.2, -0.1, 1.0])
    np.testing.assert_allclose((fine.K @ point)[:2], 2 * (K @ point)[:2] + 0.5)
    assert fine.size == (120, 88)


def test_the_same_meshes_are_uploaded_once(renderer: MeshRenderer, grey: Paint) -> None:
    mesh = quad(rectangle((10, 10), (40, 30), 2.0), grey)
    first = renderer.draw([mesh], at_origin(), None)
    again = renderer.draw([mesh], at_origin(), None)
    np.testing.assert_array_equal(first.rgb, again.rgb)
    other = quad(rectangle((20, 10), (40, 30), 2.0), grey)
    assert renderer.draw([other], at_origin(), None).labels[15, 15] == 0


def self_test(**environment: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "actorsnerf_preprocess.renderer"],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_self_test_names_the_renderer() -> None:
    done = self_test()
    assert done.returncode == 0
    assert done.stdout.startswith("headless GL works: ")


def test_without_gl_the_self_test_says_what_to_install() -> None:
    done = self_test(__EGL_VENDOR_LIBRARY_FILENAMES="/nowhere")
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "cannot draw without a screen" in done.stderr
    assert "apt-get install -y --no-install-recommends libegl1 libgl1" in done.stderr
