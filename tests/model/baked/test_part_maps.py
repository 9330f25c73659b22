import itertools

import pytest
import torch
from torch import Tensor

from actorsnerf_model.baked.actor import BakedState
from actorsnerf_model.baked.bricks import VISIBLE_DENSITY, look_up
from actorsnerf_model.baked.part_maps import PARTS, PartMaps, live_parts

SIZES = (7, 6, 8)
"""Nodes along x, y, z."""
THRESHOLD = 0.01


def nodes() -> Tensor:
    axes = [torch.arange(size) for size in SIZES]
    return torch.stack(torch.meshgrid(*axes, indexing="ij")).reshape(3, -1).float()


def cells() -> Tensor:
    axes = [torch.arange(size - 1) for size in SIZES]
    return torch.stack(torch.meshgrid(*axes, indexing="ij")).reshape(3, -1)


def rows_of(places: Tensor, likelihood: Tensor) -> Tensor:
    return torch.cat([places, torch.ones_like(places[:1]), likelihood[None]])


def turned(state: BakedState, generator: torch.Generator, stretch: float) -> tuple[Tensor, Tensor]:
    """A random linear map that takes the grid onto the actor's chest."""
    matrix, _ = torch.linalg.qr(torch.randn(3, 3, generator=generator))
    matrix = 0.06 * matrix @ torch.diag(torch.tensor([1.0, stretch, 1.0]))
    middle = (torch.tensor(SIZES) - 1) / 2
    return matrix, state.data.canonical_joints[9] - matrix @ middle


def mapped(found: PartMaps, which: Tensor, inside: Tensor) -> Tensor:
    """Points inside parts through the parts' maps, one by one."""
    place = found.parts[:, which] + inside
    maps = found.maps[:, found.number[which]].reshape(4, 4, -1)
    return maps[0] + (maps[1:] * place[:, None]).sum(0)


@pytest.mark.parametrize("stretch", [1.0, 1.7])
def test_a_linear_warp_is_its_own_map(
    state: BakedState, generator: torch.Generator, stretch: float
) -> None:
    matrix, shift = turned(state, generator, stretch)
    likelihood = 0.2 + 0.01 * nodes()[0]
    rows = rows_of(matrix @ nodes() + shift[:, None], likelihood)
    found = live_parts(rows, cells(), SIZES, state.filled, THRESHOLD)
    assert found.parts.shape[1] > 50 and not found.rough.any()
    which = torch.randint(0, found.parts.shape[1], (500,), generator=generator)
    inside = torch.rand(3, 500, generator=generator)
    there = (found.parts[:, which] + inside) / PARTS
    wanted = torch.cat([matrix @ there + shift[:, None], 0.2 + 0.01 * there[:1]])
    torch.testing.assert_close(mapped(found, which, inside), wanted, atol=1e-5, rtol=0)


@pytest.mark.parametrize("stretch", [0.5, 1.0, 1.7])
@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_no_part_with_anything_visible_is_missed(
    state: BakedState, generator: torch.Generator, stretch: float, bend: float
) -> None:
    """Points everywhere, through the warp between the nodes of their cell."""
    matrix, shift = turned(state, generator, stretch)
    away = bend * (torch.rand(3, nodes().shape[1], generator=generator) - 0.5)
    likelihood = THRESHOLD * (3 - nodes()[0] + 20 * away[0])
    rows = rows_of(matrix @ nodes() + shift[:, None] + away, likelihood)
    found = live_parts(rows, cells(), SIZES, state.filled, THRESHOLD)
    assert bool(found.rough.any()) == (bend > 0)
    # Points of rough cells are asked the exact warp, which no node bounds: all their parts stay.
    kept = torch.bincount(found.number, minlength=found.rough.shape[0])
    assert bool((kept[found.rough] == PARTS**3).all())
    live = torch.zeros([(size - 1) * PARTS for size in SIZES], dtype=torch.bool)
    live[found.parts.unbind(0)] = True
    assert 0.02 < float(live.float().mean()) < 0.8
    last = torch.tensor(SIZES)[:, None] - 1
    points = torch.rand(3, 60000, generator=generator) * last
    cell, volume = points.floor().long(), rows[[0, 1, 2, 4]].reshape(4, *SIZES)
    share = points - cell
    there = torch.zeros(4, points.shape[1])
    for corner in torch.cartesian_prod(*[torch.tensor([0, 1])] * 3):
        side = corner[:, None]
        weight = torch.where(side > 0, share, 1 - share).prod(0)
        there += weight * volume[:, *(cell + side).unbind(0)]
    _, density = look_up(state.table, there[:3].T)
    seen = ((density > VISIBLE_DENSITY) & (there[3] >= THRESHOLD)).nonzero()[:, 0]
    assert seen.shape[0] > 100
    part = (points[:, seen] * PARTS).floor().long()
    assert live[part.unbind(0)].all()


def test_what_is_unlikely_or_unheld_is_dead(state: BakedState, generator: torch.Generator) -> None:
    matrix, shift = turned(state, generator, 1.0)
    places = matrix @ nodes() + shift[:, None]
    none = torch.zeros_like(places[0])
    unlikely = live_parts(rows_of(places, none), cells(), SIZES, state.filled, THRESHOLD)
    assert unlikely.parts.shape == (3, 0) and unlikely.maps.shape[0] == 16
    unheld = torch.zeros(5, places.shape[1])
    assert live_parts(unheld, cells(), SIZES, state.filled, THRESHOLD).parts.shape == (3, 0)
    far = rows_of(places + 50, none + 1)
    assert live_parts(far, cells(), SIZES, state.filled, THRESHOLD).parts.shape == (3, 0)


def test_a_node_that_no_bone_holds_has_no_say(
    state: BakedState, generator: torch.Generator
) -> None:
    matrix, shift = turned(state, generator, 1.0)
    rows = rows_of(matrix @ nodes() + shift[:, None], torch.ones(nodes().shape[1]))
    rows[:, (nodes() == 3).all(0)] = 0
    found = live_parts(rows, cells(), SIZES, state.filled, THRESHOLD)
    beside = {
        tuple(part) for part in (found.parts[:, found.rough[found.number]] // PARTS).T.tolist()
    }
    around = set(itertools.product((2, 3), repeat=3))
    assert len(beside) > 1 and beside <= around
