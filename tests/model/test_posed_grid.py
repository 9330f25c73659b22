from collections.abc import Callable
from typing import Protocol

import pytest
import torch

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked import (
    BakedActor,
    BakedActorData,
    BakedPose,
    BakedState,
    baked_state,
    instance_points,
)
from actorsnerf_model.baking import BakeReport
from actorsnerf_model.bricks import VISIBLE_DENSITY, look_up, read_corners
from actorsnerf_model.posed_grid import PARTS, filled_voxels, places_of

Bake = Callable[[float], tuple[BakedActorData, BakeReport]]


class Fitted(Protocol):
    method: ActorsNeRF
    actor: ActorsNeRFState
    views: tuple[View, ...]


@pytest.fixture
def state(baked_at: Bake) -> BakedState:
    return baked_state(baked_at(0.04)[0])


@pytest.fixture
def pose(fitted: Fitted, state: BakedState) -> BakedPose:
    return BakedActor().pose_state(state, fitted.views[3].pose, fitted.views[3].rest_joints)


def test_every_visible_place_is_in_a_filled_cell(
    state: BakedState, generator: torch.Generator
) -> None:
    field = state.data.field
    filled = filled_voxels(field, 0.0)
    size = torch.tensor(field.index.shape[::-1]) * 4 * field.voxel
    points = field.low + torch.rand(20000, 3, generator=generator) * size
    _, density = look_up(state.table, points)
    seen = points[density > VISIBLE_DENSITY]
    assert seen.shape[0] > 200
    cell = ((seen - filled.low) / filled.edge).floor().long()
    assert filled.cells[cell[:, 2], cell[:, 1], cell[:, 0]].all()
    wide = filled_voxels(field, 0.05)
    assert int(wide.cells.sum()) > 1.3 * int(filled.cells.sum())
    for axis in range(3):
        for side in (0, -1):
            assert not wide.cells.select(axis, side).any()


def test_nodes_and_the_space_between_follow_the_warp(
    state: BakedState, pose: BakedPose, generator: torch.Generator
) -> None:
    grid = pose.grid
    part = grid.parts[torch.randint(0, grid.parts.shape[0], (3000,), generator=generator)]
    cell = torch.div(part, PARTS, rounding_mode="floor")
    _, y, z = grid.sizes
    first = (cell[:, 0] * y + cell[:, 1]) * z + cell[:, 2]
    for share, bounds in ((torch.zeros(3000, 3), (1e-5, 1e-4)), (None, (1e-3, 2e-2))):
        inside = torch.rand(3000, 3, generator=generator) if share is None else share
        points = grid.low + (cell + inside) * grid.spacing
        rows = read_corners(grid.rows, first, inside.T.contiguous(), (1, z, y * z))
        located = BakedActor().locate(state, pose, points, 0.05)
        exact = instance_points(state, pose, located.canonical)
        missed = (places_of(rows)[located.index] - exact).norm(dim=-1)
        assert located.index.shape[0] > 500
        assert float(missed.median()) < bounds[0]
        assert float(missed.quantile(0.95)) < bounds[1]


def test_live_parts_miss_hardly_anything_visible(
    state: BakedState, pose: BakedPose, generator: torch.Generator
) -> None:
    low, high = pose.bounds
    points = low + (high - low) * torch.rand(200000, 3, generator=generator)
    located = BakedActor().locate(state, pose, points, state.data.threshold)
    density = BakedActor().field(state, pose, located).density
    seen = points[located.index[density > 5 * VISIBLE_DENSITY]]
    assert seen.shape[0] > 1000
    part = ((seen - pose.grid.low) * (PARTS / pose.grid.spacing)).floor().long()
    assert float(pose.grid.live[part.unbind(-1)].float().mean()) > 0.99
    share = float(pose.grid.live.float().mean())
    assert share < 0.3
