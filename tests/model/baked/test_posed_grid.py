import dataclasses

import pytest
import torch
from torch import Tensor

from actorsnerf_model.baked.actor import BakedActor, BakedPose, BakedState, instance_points
from actorsnerf_model.baked.bricks import VISIBLE_DENSITY
from actorsnerf_model.baked.filled_voxels import grown
from actorsnerf_model.baked.posed_grid import CELL, PosedGrid, posed_grid
from actorsnerf_model.skinning_bounds import locate


def parts_of(grid: PosedGrid, points: Tensor) -> tuple[Tensor, ...]:
    return ((points - grid.low) / grid.edge).floor().long().unbind(-1)


def mapped(grid: PosedGrid, points: Tensor) -> tuple[Tensor, Tensor]:
    """Points in live parts through their maps, and whether those are rough."""
    number = grid.number[parts_of(grid, points)].long()
    maps = grid.maps[:, number].reshape(4, 4, -1)
    place = ((points - grid.low) / grid.edge).T
    return maps[0] + (maps[1:] * place[:, None]).sum(0), grid.rough[number]


def visible(state: BakedState, pose: BakedPose, count: int, generator: torch.Generator) -> Tensor:
    """Random points where the field shows something through the exact warp."""
    low, high = pose.bounds
    points = low + (high - low) * torch.rand(count, 3, generator=generator)
    located = BakedActor().locate(state, pose, points, state.data.threshold)
    density = BakedActor().field(state, pose, located).density
    found: Tensor = points[located.index[density > VISIBLE_DENSITY]]
    return found


def wild(state: BakedState, seed: int, spread: float) -> BakedPose:
    """A random pose; at a spread of 1 radian limbs pass through each other."""
    generator = torch.Generator().manual_seed(seed)
    angles = spread * torch.randn(24, 3, generator=generator)
    angles[0] = 0
    return BakedActor().pose_state(state, angles, state.data.home_joints)


def test_maps_are_the_warp_where_it_is_smooth(
    state: BakedState, pose: BakedPose, generator: torch.Generator
) -> None:
    grid = pose.grid
    part = grid.parts[:, torch.randint(0, grid.parts.shape[1], (3000,), generator=generator)]
    points = grid.low + (part.T + torch.rand(3000, 3, generator=generator)) * grid.edge
    volume, motions = state.data.skinning, pose.canonical_from_body
    located = locate(points, volume, state.bounds, motions, 0.02)
    exact = instance_points(state, pose, located.canonical)
    found, rough = mapped(grid, points[located.index])
    missed = (found[:3].T - exact).norm(dim=-1)
    assert int((~rough).sum()) > 500 and 0.0 < float(rough.float().mean()) < 0.6
    assert float(missed[~rough].median()) < 2e-3
    assert float(missed[~rough].quantile(0.99)) < 0.012


def test_the_warp_that_rough_cells_ask_is_exact(
    state: BakedState, pose: BakedPose, generator: torch.Generator
) -> None:
    low, high = pose.bounds
    points = low + (high - low) * torch.rand(5000, 3, generator=generator)
    found = pose.warp(points.T.contiguous())
    located = BakedActor().locate(state, pose, points, 0.01)
    exact = instance_points(state, pose, located.canonical)
    assert located.index.shape[0] > 200
    torch.testing.assert_close(found[:3].T[located.index], exact, atol=1e-3, rtol=0)


@pytest.mark.parametrize("spread", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_visible_is_outside_the_live_parts(
    state: BakedState, generator: torch.Generator, spread: float, seed: int
) -> None:
    """Through the exact warp, in ordinary poses and in impossible ones.

    The grid's proof is for the warp between its nodes; where the exact one differs, a sample at
    the rim may be missed, but never anything a part's width away.
    """
    pose = wild(state, seed, spread)
    seen = visible(state, pose, 200000, generator)
    assert seen.shape[0] > 1000
    live = pose.grid.number >= 0
    assert float(live[parts_of(pose.grid, seen)].float().mean()) > 0.999
    assert grown(live)[parts_of(pose.grid, seen)].all()
    assert float(live.float().mean()) < 0.4


def test_growing_finds_what_no_anchor_reaches(state: BakedState, pose: BakedPose) -> None:
    """Only one bone's anchors are left; the rest hangs together with them."""
    few = dataclasses.replace(
        state.anchors,
        points=tuple(
            points if bone == 9 else points[:, :0]
            for bone, points in enumerate(state.anchors.points)
        ),
    )
    limits = (pose.bounds, state.data.threshold)
    grid = posed_grid(few, state.filled, pose.body_from_canonical, limits, pose.warp)
    assert torch.equal(grid.number >= 0, pose.grid.number >= 0)


def test_the_outermost_layer_is_dead_and_parts_have_maps(pose: BakedPose) -> None:
    grid = pose.grid
    for axis in range(3):
        for side in (0, -1):
            assert (grid.number.select(axis, side) < 0).all()
    assert grid.edge == CELL / 2 and grid.maps.shape == (16, grid.rough.shape[0])
    number = grid.number[grid.parts.unbind(0)]
    assert (number >= 0).all() and int((grid.number >= 0).sum()) == grid.parts.shape[1]
    assert set(number.tolist()) <= set(range(grid.maps.shape[1]))


def test_nobody_is_nowhere(state: BakedState, pose: BakedPose) -> None:
    none = dataclasses.replace(state.filled, rings=torch.full_like(state.filled.rings, 255))
    limits = (pose.bounds, state.data.threshold)
    grid = posed_grid(state.anchors, none, pose.body_from_canonical, limits, pose.warp)
    assert grid.parts.shape == (3, 0) and not (grid.number >= 0).any()
