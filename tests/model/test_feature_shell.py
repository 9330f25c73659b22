from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from actorsnerf_model.feature_shell import (
    SLACK,
    FeatureShell,
    feature_shell,
    in_shell,
    shell_occupancy,
)
from actorsnerf_model.pose_plans import PosePlans
from actorsnerf_model.sparse_conv import FeatureLevel, SparseConfig, SparseNet, query

CONFIG = SparseConfig(voxel=0.04, channels=(2, 2, 2), convolutions=(1, 1, 1), taps=(0, 1, 2))


def levels_around(points: Tensor, taps: tuple[int, ...] = (0, 1, 2)) -> tuple[FeatureLevel, ...]:
    """Features that are 1 on every active voxel."""
    net = SparseNet(replace(CONFIG, taps=taps), 2).to(points.dtype)
    plan = PosePlans(CONFIG.voxel, len(CONFIG.channels)).plan(points)
    with torch.no_grad():
        made = net(torch.ones(len(points), 2, dtype=points.dtype), plan, points.dtype)
    return tuple(replace(level, features=torch.ones_like(level.features)) for level in made)


def body(seed: int, dtype: torch.dtype = torch.float64) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(30, 3, generator=generator, dtype=dtype) * 0.25


def around(shell: FeatureShell, seed: int, count: int = 4000) -> Tensor:
    generator = torch.Generator().manual_seed(seed + 1)
    size = torch.tensor(list(reversed(shell.cells.shape))) * shell.cell
    drawn = torch.rand(count, 3, generator=generator, dtype=shell.origin.dtype)
    return shell.origin - 3 * shell.cell + drawn * (size + 4 * shell.cell)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_features_reach_the_shell_and_nothing_else(seed: int) -> None:
    levels = levels_around(body(seed))
    shell = feature_shell(levels)
    points = around(shell, seed)
    inside = in_shell(shell, points)
    assert 0.02 < inside.double().mean() < 0.98
    # Every level's features are zero outside; the coarsest's are positive inside.
    assert not bool(query(levels, points[~inside]).any())
    assert bool((query(levels[2:], points[inside]) > 0).all())


def test_the_coarsest_tapped_level_decides() -> None:
    points = body(3)
    wide, narrow = levels_around(points), levels_around(points, (0, 1))
    assert feature_shell(wide).cell == pytest.approx(0.16)
    assert feature_shell(tuple(reversed(wide))).cell == pytest.approx(0.16)
    assert feature_shell(narrow).cell == pytest.approx(0.08)


def test_one_vertex_by_hand() -> None:
    index = torch.full((3, 4, 5), -1, dtype=torch.int32)
    index[1, 2, 4] = 0
    level = FeatureLevel(torch.ones(1, 1), index, torch.tensor([10.0, 20.0, 30.0]), 2.0)
    shell = feature_shell([level])
    middle = torch.tensor([10.0 + 8, 20 + 4, 30 + 2])
    assert int(shell.cells.sum()) == 8
    for axis in range(3):
        for side in (-1.0, 1.0):
            away = torch.zeros(3)
            away[axis] = side
            assert bool(in_shell(shell, (middle + 1.99 * away)[None]).all())
            assert not bool(in_shell(shell, (middle + 2.01 * away)[None]).any())
    far = torch.tensor([[1e9, 0.0, 0.0], [-1e9, 24.0, 32.0], [18.0, 24.0, -1e9]])
    assert not bool(in_shell(shell, far).any())


def cell_of(points: Tensor, box: Tensor, shape: torch.Size) -> tuple[Tensor, ...]:
    sizes = torch.tensor(shape)
    place = ((points - box[0]) / (box[1] - box[0]) * sizes).floor().long()
    return place.clamp(torch.zeros_like(sizes), sizes - 1).unbind(-1)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_no_point_of_the_shell_is_in_an_empty_cell(seed: int) -> None:
    shell = feature_shell(levels_around(body(seed, torch.float32)))
    bounds = torch.tensor([[-0.6, -0.5, -0.7], [0.5, 0.71, 0.4]])
    occupancy = shell_occupancy(shell, bounds, 0.01)
    generator = torch.Generator().manual_seed(seed)
    points = bounds[0] + torch.rand(4000, 3, generator=generator) * (bounds[1] - bounds[0])
    # As many on the shell's own faces, give or take rounding.
    faces = ((points - shell.origin) / shell.cell).round() * shell.cell + shell.origin
    points = torch.cat([points, torch.cat([faces[:, :1], points[:, 1:]], 1), faces])
    points = points[((points >= bounds[0]) & (points <= bounds[1])).all(1)]
    inside = in_shell(shell, points)
    occupied = occupancy.cells[cell_of(points, occupancy.box, occupancy.cells.shape)]
    assert bool(occupied[inside].all())
    # And few cells more: one beside the shell at most.
    edge = float((occupancy.box[1, 0] - occupancy.box[0, 0]) / occupancy.cells.shape[0])
    beside = (torch.cartesian_prod(*[torch.tensor([-1.0, 0.0, 1.0])] * 3) * (edge + 3e-4))[:, None]
    near = torch.stack([in_shell(shell, points + step) for step in beside]).any(0)
    assert bool(near[occupied].all())
    assert occupancy.threshold == 0.01


def test_cells_are_small_beside_the_shells() -> None:
    """At most half of the shell's, so that one meets two of them along an axis, and 3 cm."""
    shell = feature_shell(levels_around(body(1)))
    bounds = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], dtype=torch.float64)
    for cell, edge in ((shell.cell, 0.03), (0.02, 0.01)):
        occupancy = shell_occupancy(replace(shell, cell=cell), bounds, 0.5)
        sizes = torch.tensor(occupancy.cells.shape)
        torch.testing.assert_close(
            (occupancy.box[1] - occupancy.box[0]) / sizes, bounds.new_full((3,), edge)
        )


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rounding_on_a_common_face_loses_nothing(axis: int, side: int) -> None:
    """A sample just inside the shell may be taken for one just outside, in the next cell."""
    index = torch.full((3, 3, 3), -1, dtype=torch.int32)
    index[1, 1, 1] = 0
    origin = torch.zeros(3, dtype=torch.float64)
    shell = feature_shell([FeatureLevel(torch.ones(1, 1), index, origin, 2.0)])
    face = torch.full((3,), 2.0, dtype=torch.float64)
    face[axis] += 2 * side
    # The face is one of the box's cells' own.
    bounds = torch.stack([face - 100 * 0.03, face + 100 * 0.03])
    occupancy = shell_occupancy(shell, bounds, 0.5)
    outward = torch.zeros(3, dtype=torch.float64)
    outward[axis] = side
    assert bool(in_shell(shell, (face - 1e-9 * outward)[None]).all())
    taken = (face + 0.9 * SLACK * outward)[None]
    assert bool(occupancy.cells[cell_of(taken, occupancy.box, occupancy.cells.shape)].all())
    beyond = (face + (0.03 + 2 * SLACK) * outward)[None]
    assert not bool(occupancy.cells[cell_of(beyond, occupancy.box, occupancy.cells.shape)].any())
