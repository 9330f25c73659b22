import numpy as np
import pytest

from actorsnerf_datasets.body_box import BOX_MARGIN, body_box, box_mask, meets_box
from actorsnerf_datasets.types import Float64

K = np.array([[10.0, 0.0, 4.5], [0.0, 10.0, 3.5], [0.0, 0.0, 1.0]])
BOX = np.array([[-1.0, -1.0, 9.0], [1.0, 1.0, 11.0]])
STRAIGHT = np.array([[4.5, 3.5]])
"""The pixel on the optical axis."""


def moved(x: float, y: float, z: float) -> Float64:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def test_box_is_the_joints_and_the_margin(rng: np.random.Generator) -> None:
    joints = rng.normal(size=(24, 3))
    lower, upper = body_box(joints)
    assert np.allclose(lower + BOX_MARGIN, joints.min(axis=0))
    assert np.allclose(upper - BOX_MARGIN, joints.max(axis=0))


@pytest.mark.parametrize(
    ("camera_from_body", "hit"),
    [
        (moved(0, 0, 0), True),  # in front
        (moved(0, 0, -10), True),  # the camera is inside the box
        (moved(0, 0, -30), False),  # behind the camera
        (moved(1, 0, 0), True),  # parallel to a face and in it
        (moved(1.001, 0, 0), False),  # parallel to a face and beside it
        (moved(1, 1, 0), True),  # along an edge
        (moved(0, 0, -11), False),  # the camera on the far face looks away
    ],
)
def test_the_central_ray(camera_from_body: Float64, hit: bool) -> None:
    assert meets_box(STRAIGHT, K, camera_from_body, BOX).tolist() == [hit]


def test_mask_by_hand() -> None:
    # The near face is at z = 9: half a metre there is 10 / 9 pixels, from the centre (4.5, 3.5).
    mask = box_mask((10, 8), K, np.eye(4), BOX)
    assert mask.shape == (8, 10)
    rows, columns = np.nonzero(mask)
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (4, 5, 3, 4)
    assert mask.sum() == 4


def test_mask_equals_points_marched_along_rays(rng: np.random.Generator) -> None:
    angle = 0.7
    camera_from_body = moved(0.4, -0.3, 2.0)
    camera_from_body[:3, :3] = [
        [np.cos(angle), 0, np.sin(angle)],
        [0, 1, 0],
        [-np.sin(angle), 0, np.cos(angle)],
    ]
    box = np.array([[-0.7, -0.5, -0.3], [0.6, 0.8, 0.9]])
    mask = box_mask((10, 8), K, camera_from_body, box)
    body_from_camera = np.linalg.inv(camera_from_body)
    depths = np.linspace(0.001, 6, 6000)
    for y in range(8):
        for x in range(10):
            ray = np.linalg.inv(K) @ [x, y, 1]
            points = (depths[:, None] * ray) @ body_from_camera[:3, :3].T + body_from_camera[:3, 3]
            slack = 2e-3 * (1 if mask[y, x] else -1)  # marching misses grazing rays
            inside = ((points >= box[0] - slack) & (points <= box[1] + slack)).all(axis=1)
            assert inside.any() == mask[y, x]
    assert 0 < mask.sum() < mask.size
