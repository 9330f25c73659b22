import math

import pytest
import torch
from torch import Tensor

from actorsnerf_model.baked.actor import BakedPose
from actorsnerf_model.baked.part_shadows import part_shadows, stretches
from actorsnerf_model.projection import project
from actorsnerf_model.rays import rays_through
from actorsnerf_model.states import Camera


def camera_at(distance: float, focal: float, size: tuple[int, int] = (90, 70)) -> Camera:
    into = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0]))
    into[:3, 3] = torch.tensor([0.1, -0.3, distance])
    width, height = size
    K = torch.tensor([[focal, 0, width / 2], [0, 1.1 * focal, height / 2], [0, 0, 1]])
    return Camera(K, into, size)


def points_in_parts(pose: BakedPose, generator: torch.Generator) -> Tensor:
    grid = pose.grid
    which = torch.randint(0, grid.parts.shape[1], (20000,), generator=generator)
    inside = torch.rand(20000, 3, generator=generator)
    return grid.low + (grid.parts[:, which].T + inside) * grid.edge


@pytest.mark.parametrize(("distance", "focal"), [(3.0, 60.0), (3.0, 600.0), (1.2, 50.0)])
def test_every_point_of_a_part_is_in_its_tile_between_near_and_far(
    pose: BakedPose, generator: torch.Generator, distance: float, focal: float
) -> None:
    """Tiles of one pixel, of several, and parts that stick out of the picture."""
    camera = camera_at(distance, focal)
    shadow = part_shadows(pose.grid, camera)
    assert shadow is not None
    points = points_in_parts(pose, generator)
    seen = project(points, camera.K, camera.camera_from_body)
    x, y = seen.pixels.round().long().unbind(-1)
    inside = (x >= 0) & (x < 90) & (y >= 0) & (y < 70)
    assert int(inside.sum()) > 1000
    x, y, depth = x[inside], y[inside], seen.depth[inside]
    rays = stretches(shadow, x, y, camera)
    assert (rays.near <= depth).all() and (depth <= rays.far).all()
    left, right, top, bottom = shadow.window
    assert ((x >= left) & (x < right) & (y >= top) & (y < bottom)).all()
    assert shadow.nearest <= float(depth.min())
    tight = (rays.far - rays.near).median()
    assert float(tight) < 1.0


def test_rays_are_those_of_the_pixels(pose: BakedPose) -> None:
    camera = camera_at(3.0, 60.0)
    shadow = part_shadows(pose.grid, camera)
    assert shadow is not None
    x, y = torch.tensor([0, 45, 89]), torch.tensor([69, 35, 0])
    rays = stretches(shadow, x, y, camera)
    wanted = rays_through(torch.stack([x, y], -1).float(), camera)
    torch.testing.assert_close(rays.directions.T, wanted.directions, atol=1e-5, rtol=0)
    assert torch.equal(rays.origin, wanted.origin)
    assert math.isinf(float(rays.near[0])) and float(rays.far[0]) == 0


@pytest.mark.parametrize("distance", [-5.0, 1e5])
def test_nothing_is_seen_behind_the_camera_and_little_far_away(
    pose: BakedPose, distance: float
) -> None:
    shadow = part_shadows(pose.grid, camera_at(distance, 60.0))
    assert shadow is not None
    left, right, top, bottom = shadow.window
    assert (right - left) * (bottom - top) <= (0 if distance < 0 else 100)


def test_a_camera_amid_the_parts_cannot_tell(pose: BakedPose) -> None:
    assert part_shadows(pose.grid, camera_at(0.0, 60.0)) is None
