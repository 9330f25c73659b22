import pytest
import torch
import torch.nn.functional as F
from torch.autograd import gradcheck

from actorsnerf_model.interpolation import ROWS_AT_ONCE, bilinear, corners, trilinear


def normalised(coordinates: torch.Tensor, sizes: tuple[int, ...]) -> torch.Tensor:
    return 2 * coordinates / (torch.tensor(sizes, dtype=coordinates.dtype) - 1) - 1


def anywhere(
    count: int,
    sizes: tuple[int, ...],
    generator: torch.Generator,
    dtype: torch.dtype = torch.float64,
) -> torch.Tensor:
    """Inside, at nodes, on the border, and up to several nodes outside."""
    span = torch.tensor(sizes, dtype=dtype) + 5
    free = torch.rand(count, len(sizes), generator=generator, dtype=dtype) * span - 3
    return torch.cat([free, free.round()])


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_bilinear_is_grid_sample(generator: torch.Generator, dtype: torch.dtype) -> None:
    table = torch.randn(5, 7, 4, generator=generator, dtype=dtype)
    xy = anywhere(300, (7, 5), generator, dtype)
    grid = normalised(xy, (7, 5))[None, None]
    expected = F.grid_sample(table.permute(2, 0, 1)[None], grid, align_corners=True)[0, :, 0].T
    tolerance = 1e-5 if dtype == torch.float32 else 1e-12
    torch.testing.assert_close(bilinear(table[None], xy[None])[0], expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_trilinear_is_grid_sample(generator: torch.Generator, dtype: torch.dtype) -> None:
    volume = torch.randn(4, 5, 6, 3, generator=generator, dtype=dtype)
    xyz = anywhere(300, (6, 5, 4), generator, dtype)
    grid = normalised(xyz, (6, 5, 4))[None, None, None]
    sampled = F.grid_sample(volume.permute(3, 0, 1, 2)[None], grid, align_corners=True)
    tolerance = 1e-5 if dtype == torch.float32 else 1e-12
    torch.testing.assert_close(
        trilinear(volume, xyz), sampled[0, :, 0, 0].T, rtol=0, atol=tolerance
    )


def test_a_linear_field_is_read_exactly() -> None:
    z, y, x = torch.meshgrid(torch.arange(3.0), torch.arange(4.0), torch.arange(5.0), indexing="ij")
    volume = torch.stack([x + 10 * y + 100 * z], -1)
    found = trilinear(volume, torch.tensor([[1.25, 2.5, 0.5]]))
    torch.testing.assert_close(found, torch.tensor([[1.25 + 25 + 50]]))


def test_one_node_wide_grids_fade_to_zero_around_the_node() -> None:
    table = torch.full((1, 1, 1), 8.0)
    xy = torch.tensor([[0.0, 0.0], [0.5, 0.0], [-0.25, 0.5], [1.0, 0.0]])
    assert bilinear(table[None], xy[None])[0, :, 0].tolist() == [8.0, 4.0, 3.0, 0.0]


def test_gradients(generator: torch.Generator) -> None:
    volume = torch.randn(3, 4, 5, 2, generator=generator, dtype=torch.float64, requires_grad=True)
    xyz = anywhere(20, (5, 4, 3), generator)[:20] + 1e-3
    assert gradcheck(trilinear, (volume, xyz.requires_grad_()))
    tables = torch.randn(2, 4, 5, 2, generator=generator, dtype=torch.float64, requires_grad=True)
    xy = (anywhere(20, (5, 4), generator) + 1e-3).reshape(2, 20, 2)
    assert gradcheck(bilinear, (tables, xy.requires_grad_()))


def test_each_table_is_read_at_its_own_points_alone(generator: torch.Generator) -> None:
    """Also where a point lies outside, one row before the next table's first."""
    tables = torch.randn(3, 4, 5, 2, generator=generator)
    xy = anywhere(50, (5, 4), generator, torch.float32)
    xy = torch.stack([xy, xy.flip(0), xy + 0.25])
    together = bilinear(tables, xy)
    for number in range(3):
        alone = bilinear(tables[number : number + 1], xy[number : number + 1])
        assert torch.equal(together[number : number + 1], alone)


def test_the_gradient_of_the_table_does_not_depend_on_pieces(generator: torch.Generator) -> None:
    tables = torch.randn(2, 6, 6, 2, generator=generator)
    xy = anywhere(ROWS_AT_ONCE, (6, 6), generator, torch.float32).reshape(2, ROWS_AT_ONCE, 2)
    without = bilinear(tables, xy)  # in pieces
    with_gradient = bilinear(tables.clone().requires_grad_(), xy)
    torch.testing.assert_close(without, with_gradient.detach(), rtol=0, atol=0)


def test_a_layer_runs_on_the_rows_that_are_read_alone(generator: torch.Generator) -> None:
    tables = torch.rand(2, 7, 5, 3, dtype=torch.float64, generator=generator, requires_grad=True)
    weight = torch.rand(4, 3, dtype=torch.float64, generator=generator, requires_grad=True)
    near = torch.rand(2, 6, 2, dtype=torch.float64, generator=generator, requires_grad=True)
    ran: list[int] = []

    def layer(rows: torch.Tensor) -> torch.Tensor:
        ran.append(rows.shape[0])
        return F.linear(rows, weight)

    some = bilinear(tables, 1.5 + near, layer)  # between nodes 1 and 3 of each axis
    whole = bilinear(F.linear(tables, weight), 1.5 + near)
    torch.testing.assert_close(some, whole, rtol=0, atol=1e-14)
    assert len(ran) == 1 and 2 * 4 < ran[0] <= 2 * 9
    given = (tables, weight, near)
    for found, expected in zip(
        torch.autograd.grad((some**2).sum(), given),
        torch.autograd.grad((whole**2).sum(), given),
        strict=True,
    ):
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)
    assert bilinear(tables, near[:, :0], layer).shape == (2, 0, 4)


@pytest.mark.parametrize("wants_gradient", [True, False])
def test_no_points(wants_gradient: bool) -> None:
    tables = torch.ones(2, 2, 2, 3, requires_grad=wants_gradient)
    assert bilinear(tables, torch.zeros(2, 0, 2)).shape == (2, 0, 3)


def test_far_and_infinite_coordinates_read_zero() -> None:
    xy = torch.tensor([[1e30, 0.0], [-torch.inf, 0.0], [torch.inf, torch.inf], [0.0, -1e9]])
    assert bilinear(torch.ones(1, 3, 3, 1), xy[None]).abs().max() == 0


def test_what_is_no_number_stays_so_and_reads_no_foreign_memory() -> None:
    xy = torch.tensor([[torch.nan, 1.0], [1.0, 1.0]])
    index, _ = corners(xy, (3, 3))
    assert int(index.min()) >= 0 and int(index.max()) < 9
    read = bilinear(torch.ones(1, 3, 3, 1), xy[None])[0, :, 0]
    assert bool(read[0].isnan()) and read[1] == 1


def test_corners_outside_have_no_weight() -> None:
    index, weight = corners(torch.tensor([[-0.25, 0.0]]), (2, 3))
    inside = weight[0] > 0
    assert index[0][inside].tolist() == [0]
    assert weight[0].sum() == 0.75
