import dataclasses
import math

import torch
from torch import Tensor

from actorsnerf_model.baked.actor import BakedPose, BakedState
from actorsnerf_model.baked.bricks import look_up
from actorsnerf_model.baked.march import LEAST_WEIGHT, STEP, march
from actorsnerf_model.baked.part_shadows import Stretches

STOP = 1 / 256
THRESHOLD = 0.01


def rays_at(pose: BakedPose, count: int, generator: torch.Generator) -> Stretches:
    """From 3 m before the body through points in live parts and around them."""
    grid = pose.grid
    which = torch.randint(0, grid.parts.shape[1], (count,), generator=generator)
    points = grid.low + (grid.parts[:, which].T + 0.5) * grid.edge
    points = points + 0.1 * torch.randn(count, 3, generator=generator)
    origin = torch.tensor([0.0, -0.3, 3.0])
    along = points - origin
    directions = (along / along[:, 2:].abs()).T.contiguous()
    depth = torch.full((count,), 3.0)
    return Stretches(origin, directions, depth - 1.0, depth + 1.0)


def slowly(state: BakedState, pose: BakedPose, rays: Stretches, number: int) -> list[float]:
    """One ray sample by sample: colour times opacity, opacity, depth times opacity."""
    grid, direction = pose.grid, rays.directions[:, number]
    passing, seen = 1.0, [0.0] * 5
    first = math.floor(float(rays.near[number]) / STEP)
    for step in range(first, math.ceil(float(rays.far[number]) / STEP)):
        depth = (step + 0.5) * STEP
        point = rays.origin + depth * direction
        part = ((point - grid.low) / grid.edge).floor().long()
        if (part < 0).any() or (part >= torch.tensor(grid.number.shape)).any():
            continue
        cell = int(grid.number[tuple(part.tolist())])
        if cell < 0:
            continue
        maps = grid.maps[:, cell].reshape(4, 4)
        there = maps[0] + ((point - grid.low) / grid.edge) @ maps[1:]
        if grid.rough[cell]:
            there = pose.warp(point[:, None])[:, 0]
        if float(there[3]) < THRESHOLD:
            continue
        rgb, density = look_up(state.table, there[None, :3])
        if passing < STOP / 10:
            break
        weight = passing * -math.expm1(-float(density) * STEP * float(direction.norm()))
        passing -= weight
        values = [*rgb[0].tolist(), 1.0, depth]
        seen = [a + weight * b for a, b in zip(seen, values, strict=True)]
    return seen


def test_a_ray_is_its_samples_one_by_one(
    state: BakedState, pose: BakedPose, generator: torch.Generator
) -> None:
    rays = rays_at(pose, 30, generator)
    found = march(state.table, pose, rays, THRESHOLD, STOP)
    together = torch.cat([found.rgb, found.alpha[None], found.depth[None]])
    wanted = torch.tensor([slowly(state, pose, rays, number) for number in range(30)]).T
    assert int((wanted[3] > 0.9).sum()) > 5 and int((wanted[3] < 0.9).sum()) > 1
    # What is left out: light up to STOP, and colours of small weight, which others stand for.
    torch.testing.assert_close(together[:4], wanted[:4], atol=STOP + 10 * LEAST_WEIGHT, rtol=0)
    torch.testing.assert_close(together[4], wanted[4], atol=4.5 * STOP, rtol=0)
    assert found.tested >= found.asked >= found.painted > 0


def test_less_light_to_stop_at_asks_more(
    state: BakedState, pose: BakedPose, generator: torch.Generator
) -> None:
    rays = rays_at(pose, 300, generator)
    early = march(state.table, pose, rays, THRESHOLD, 0.5)
    late = march(state.table, pose, rays, THRESHOLD, 1e-6)
    assert early.asked < late.asked
    assert float((late.alpha - early.alpha).amin()) > -1e-5
    assert float((late.alpha - early.alpha).amax()) < 0.5


def test_no_ray_and_an_empty_stretch(state: BakedState, pose: BakedPose) -> None:
    def zeros(*shape: int) -> Tensor:
        return torch.zeros(*shape)

    none = march(state.table, pose, Stretches(zeros(3), zeros(3, 0), zeros(0), zeros(0)), 0.01, 0.1)
    assert none.rgb.shape == (3, 0) and none.asked == 0
    away = Stretches(torch.tensor([0.0, 0.0, 50.0]), torch.ones(3, 2), zeros(2), zeros(2) + 1)
    far = march(state.table, pose, away, THRESHOLD, STOP)
    assert not far.alpha.any() and not far.rgb.any() and far.asked == 0


def test_an_unlikely_place_shows_nothing(
    state: BakedState, pose: BakedPose, generator: torch.Generator
) -> None:
    rays = rays_at(pose, 100, generator)
    assert march(state.table, pose, rays, THRESHOLD, STOP).alpha.any()
    assert not march(state.table, pose, rays, 30.0, STOP).alpha.any()
    grid = dataclasses.replace(pose.grid, number=torch.full_like(pose.grid.number, -1))
    dead = dataclasses.replace(pose, grid=grid)
    assert not march(state.table, dead, rays, THRESHOLD, STOP).alpha.any()
