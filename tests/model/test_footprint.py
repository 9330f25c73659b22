import dataclasses
from typing import TYPE_CHECKING

import pytest
import torch

from actorsnerf_model.footprint import footprint
from actorsnerf_model.projection import NEAR_PLANE
from actorsnerf_model.rays import Rays, intersect_box, rays_through
from actorsnerf_model.states import Camera, Occupancy, PoseState

if TYPE_CHECKING:
    from tests.model.conftest import ToyScene


def all_rays(camera: Camera) -> Rays:
    width, height = camera.size
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    return rays_through(torch.stack([x, y], -1).reshape(-1, 2).to(camera.K.dtype), camera)


def rays_that_meet(pose: PoseState, camera: Camera) -> torch.Tensor:
    """Every cell against every ray, by slabs."""
    grid, rays = pose.occupancy, all_rays(camera)
    assert grid is not None
    edges = (grid.box[1] - grid.box[0]) / torch.tensor(grid.cells.shape)
    low = grid.box[0] + grid.cells.nonzero() * edges
    first = (low - rays.origin)[:, None] / rays.directions
    last = (low + edges - rays.origin)[:, None] / rays.directions
    enter = torch.minimum(first, last).amax(-1).clamp(min=NEAR_PLANE)
    met = (torch.maximum(first, last).amin(-1) > enter).any(0)
    return met.reshape(camera.size[1], camera.size[0])


def moved(camera: Camera, translation: list[float]) -> Camera:
    matrix = camera.camera_from_body.clone()
    matrix[:3, 3] = torch.tensor(translation)
    return dataclasses.replace(camera, camera_from_body=matrix)


@pytest.mark.parametrize(
    "translation",
    [
        [0.05, -0.4, 3.0],  # the whole person
        [1.2, -0.4, 2.0],  # cut by the border
        [0.0, -0.4, 0.3],  # camera inside the person's box
        [0.0, -0.4, -0.2],  # most of the person behind
        [0.0, -0.4, 40.0],  # a person of one pixel
    ],
)
def test_no_pixel_that_meets_a_cell_is_left_out(
    scene: "ToyScene", translation: list[float]
) -> None:
    camera = moved(scene.camera, translation)
    mask = footprint(scene.pose, camera, True)
    met = rays_that_meet(scene.pose, camera)
    assert met.any()
    assert (mask | ~met).all()


def test_few_others_are_taken(scene: "ToyScene") -> None:
    mask = footprint(scene.pose, scene.camera, True)
    met = rays_that_meet(scene.pose, scene.camera)
    assert mask.sum() < 1.6 * met.sum()
    assert mask.sum() < 0.6 * footprint(scene.pose, scene.camera, False).sum()


def test_without_cells_the_bounds_cast_the_shadow(scene: "ToyScene") -> None:
    bare = dataclasses.replace(scene.pose, occupancy=None)
    mask = footprint(bare, scene.camera, True)
    assert torch.equal(mask, footprint(scene.pose, scene.camera, False))
    hit = intersect_box(all_rays(scene.camera), scene.pose.bounds).hit.reshape(mask.shape)
    assert (mask | ~hit).all()


def test_behind_the_camera_there_is_no_shadow(scene: "ToyScene") -> None:
    assert not footprint(scene.pose, moved(scene.camera, [0.0, 0.0, -9.0]), True).any()
    assert not footprint(scene.pose, moved(scene.camera, [0.0, 0.0, -9.0]), False).any()


def test_beside_the_picture_there_is_no_shadow(scene: "ToyScene") -> None:
    assert not footprint(scene.pose, moved(scene.camera, [90.0, 0.0, 3.0]), True).any()


def test_no_occupied_cell(scene: "ToyScene") -> None:
    full = scene.pose.occupancy
    assert full is not None
    empty = dataclasses.replace(full, cells=torch.zeros_like(full.cells))
    pose = dataclasses.replace(scene.pose, occupancy=empty)
    assert not footprint(pose, scene.camera, True).any()


def test_one_cell_by_hand(scene: "ToyScene") -> None:
    """A metre cube from 1 m on, f = 10: its near face spans pixels 2 to 12 of 16."""
    box = torch.tensor([[-0.5, -0.5, 1.0], [0.5, 0.5, 2.0]])
    pose = PoseState(
        scene.pose.pose,
        scene.pose.canonical_from_body,
        scene.pose.body_from_canonical,
        box,
        Occupancy(box, torch.ones(1, 1, 1, dtype=torch.bool), 0.01),
    )
    K = torch.tensor([[10.0, 0, 7.25], [0, 10, 7.25], [0, 0, 1]])
    mask = footprint(pose, Camera(K, torch.eye(4), (16, 16)), True)
    expected = torch.zeros(16, 16, dtype=torch.bool)
    expected[3:13, 3:13] = True  # 2.25 <= pixel <= 12.25
    assert torch.equal(mask, expected)
    assert NEAR_PLANE < 1
