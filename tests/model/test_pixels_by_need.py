import pytest
import torch
from torch import Tensor

from actorsnerf_model.pixels_by_need import Agreement, Draw, by_need

HEIGHT, WIDTH = 13, 17
AGREE = Agreement(torch.tensor([0.1, torch.inf]), torch.tensor([-torch.inf] * 2))
NEVER = Agreement(torch.zeros(2), torch.tensor([-torch.inf] * 2))


def painter(picture: Tensor) -> tuple[Draw, list[int]]:
    """Draws a known picture, and notes what it is asked."""
    asked: list[int] = []

    def draw(number: Tensor) -> Tensor:
        asked.extend(number.tolist())
        return picture.reshape(-1, picture.shape[-1])[number]

    return draw, asked


def random_picture() -> Tensor:
    return torch.rand(HEIGHT, WIDTH, 2, generator=torch.Generator().manual_seed(5))


@pytest.mark.parametrize("stride", [1, 2, 4, 8])
def test_a_restless_picture_is_drawn_pixel_by_pixel(stride: int) -> None:
    picture = random_picture()
    draw, asked = painter(picture)
    where = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    found = by_need(draw, where, torch.zeros_like(picture), stride, NEVER)
    assert torch.equal(found, picture)
    assert sorted(asked) == list(range(HEIGHT * WIDTH))  # each once


@pytest.mark.parametrize(("stride", "share"), [(2, 0.35), (4, 0.2)])
def test_a_ramp_is_interpolated_exactly(stride: int, share: float) -> None:
    x, y = torch.meshgrid(torch.arange(WIDTH), torch.arange(HEIGHT), indexing="xy")
    picture = torch.stack([0.01 * x + 0.005 * y, 3.0 * y], -1)
    draw, asked = painter(picture)
    where = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    found = by_need(draw, where, torch.zeros_like(picture), stride, AGREE)
    assert torch.allclose(found, picture, atol=1e-5)
    assert len(asked) < share * HEIGHT * WIDTH


def test_edges_are_drawn_and_the_outside_is_left_alone() -> None:
    picture = torch.zeros(HEIGHT, WIDTH, 2)
    picture[:, 7:] = 1.0
    draw, asked = painter(picture)
    where = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    where[:2] = False
    background = torch.full_like(picture, 0.5)
    found = by_need(draw, where, background, 2, AGREE)
    assert torch.equal(found[2:], picture[2:])
    assert torch.equal(found[:2], background[:2])
    columns = {number % WIDTH for number in asked}
    assert 7 in columns and min(asked) >= 2 * WIDTH
    inside = [n for n in asked if n % WIDTH in (10, 11, 12, 13) and n // WIDTH % 2]
    # Far from the edge only the rows beside the outside are in doubt.
    assert {n // WIDTH for n in inside} <= {3}


def test_colours_within_the_tolerance_are_averaged() -> None:
    picture = random_picture()
    picture[..., 0] *= 0.1
    draw, asked = painter(picture)
    where = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    found = by_need(draw, where, torch.zeros_like(picture), 2, AGREE)
    assert len(asked) == 7 * 9  # odd sides: no pixel lacks a neighbour
    assert torch.allclose(found[0, 1], (picture[0, 0] + picture[0, 2]) / 2)
    corners = picture[2, 4] + picture[2, 6] + picture[4, 4] + picture[4, 6]
    assert torch.allclose(found[3, 5], corners / 4)


def test_what_is_not_inside_is_drawn_however_alike() -> None:
    picture = torch.zeros(HEIGHT, WIDTH, 2)
    picture[:, :9] = 1.0
    draw, asked = painter(picture)
    where = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    inside = Agreement(torch.tensor([0.1, 0.1]), torch.tensor([-torch.inf, 0.5]))
    found = by_need(draw, where, torch.zeros_like(picture), 2, inside)
    assert torch.equal(found, picture)
    left = [n for n in asked if n % WIDTH < 9]
    right = [n for n in asked if n % WIDTH >= 9]
    assert len(left) == 7 * 5 and len(right) == 8 * HEIGHT
