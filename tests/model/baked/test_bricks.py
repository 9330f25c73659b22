import pytest
import torch
from torch import Tensor

from actorsnerf_model.baked.bricks import (
    CELLS,
    LEAST_DENSITY,
    MOST_DENSITY,
    SIDE,
    BrickGrid,
    activation_from_density,
    brick_table,
    density_from_activation,
    density_from_code,
    encode,
    look_up,
    read_corners,
)

LOW = torch.tensor([-1.0, 2.0, 0.5])
VOXEL = 0.1
SIZES = (2, 3, 2)
"""Bricks along z, y, x."""


@pytest.fixture
def nodes(generator: torch.Generator) -> Tensor:
    """Colour and density of all nodes (z, y, x, 4)."""
    sizes = [size * CELLS + 1 for size in SIZES]
    values = torch.rand((*sizes, 4), generator=generator)
    values[..., 3] = 10 ** (3 * values[..., 3])
    return values


@pytest.fixture
def grid(nodes: Tensor) -> BrickGrid:
    """All bricks but the first."""
    index = torch.arange(-1, 11, dtype=torch.int32).reshape(SIZES)
    places = (index >= 0).nonzero() * CELLS
    bricks = torch.stack(
        [nodes[z : z + SIDE, y : y + SIDE, x : x + SIDE] for z, y, x in places.tolist()]
    ).reshape(-1, SIDE**3, 4)
    codes, top = encode(bricks[..., :3], bricks[..., 3])
    return BrickGrid(LOW, VOXEL, index, codes, top)


def test_nodes_are_read_back_to_half_a_code(nodes: Tensor, grid: BrickGrid) -> None:
    z, y, x = torch.meshgrid(*[torch.arange(size) for size in nodes.shape[:3]], indexing="ij")
    kept = (z >= CELLS) | (y >= CELLS) | (x >= CELLS)
    kept &= (z < 2 * CELLS) & (y < 3 * CELLS) & (x < 2 * CELLS)  # the far faces belong outside
    inside = LOW + (torch.stack([x, y, z], -1)[kept] + 1e-3) * VOXEL
    rgb, density = look_up(brick_table(grid), inside)
    wanted = nodes[kept]
    assert float((rgb - wanted[:, :3]).abs().max()) < 0.5 / 255 + 4e-3
    step = (grid.top - float(activation_from_density(torch.tensor(LEAST_DENSITY)))) / 255
    missed = activation_from_density(density) - activation_from_density(wanted[:, 3])
    assert float(missed.abs().max()) < 0.51 * step + 0.2


def test_between_nodes_it_is_trilinear(grid: BrickGrid, generator: torch.Generator) -> None:
    """A slow twin, one point at a time."""
    table = brick_table(grid)
    nodes_of = (table.codes.float() / 255).T.reshape(-1, SIDE, SIDE, SIDE, 4)
    places = torch.rand(40, 3, generator=generator) * torch.tensor([8.0, 12.0, 8.0])
    rgb, density = look_up(table, LOW + places * VOXEL)
    for number, place in enumerate(places.tolist()):
        brick = [min(int(p // CELLS), size - 1) for p, size in zip(place, SIZES[::-1], strict=True)]
        row = int(grid.index[brick[2], brick[1], brick[0]])
        if row < 0:
            assert not rgb[number].any() and density[number] == 0
            continue
        node = nodes_of[row]
        for axis in (2, 1, 0):  # z first: it is the outermost axis
            local = place[axis] - brick[axis] * CELLS
            low = min(int(local), CELLS - 1)
            node = node[low] + (local - low) * (node[low + 1] - node[low])
        torch.testing.assert_close(rgb[number], node[:3], atol=1e-5, rtol=0)
        wanted = density_from_code(255 * node[3], grid.top)
        torch.testing.assert_close(density[number], wanted, atol=1e-4, rtol=1e-3)


def test_nothing_is_outside(grid: BrickGrid) -> None:
    far = torch.tensor([[9.0, 0, 0], [-9, 0, 0], [0, 1e6, 0], [0, 0, -1e6], [-1, 2, 1.31]])
    rgb, density = look_up(brick_table(grid), far)
    assert not density.any() and torch.isfinite(rgb).all()
    assert look_up(brick_table(grid), far[:0])[0].shape == (0, 3)


def test_density_comes_back_from_its_activation() -> None:
    density = torch.tensor([0.2, 1.0, 30.0, 500.0, 2900.0])
    torch.testing.assert_close(
        density_from_activation(activation_from_density(density)), density, rtol=1e-4, atol=1e-4
    )
    extremes = density_from_activation(activation_from_density(torch.tensor([0.0, 1e-9, 1e9])))
    torch.testing.assert_close(extremes, torch.tensor([0.0, 0.0, MOST_DENSITY]))


def test_hand_numbers_between_corners() -> None:
    planes = torch.stack([torch.arange(8.0), torch.full((8,), 3.0)])  # z 4, y 2, x 1
    share = torch.tensor([[0.25], [0.5], [1.0]])
    read = read_corners(planes, torch.tensor([0]), share, (4, 2, 1))
    assert read.tolist() == [[0.25 + 1.0 + 4.0], [3.0]]


def test_its_bytes(grid: BrickGrid) -> None:
    assert grid.bytes == 4 * 12 + 11 * 125 * 4
