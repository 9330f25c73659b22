import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from actorsnerf_model.volume_rendering import composite, optical_depth, shares_so_far


def loop(
    rgb: Tensor, density: Tensor, spacing: Tensor, depths: Tensor, background: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """One ray, one sample after another."""
    colour = torch.zeros(3, dtype=torch.float64)
    alpha, depth, light = colour[0], colour[0], colour[0] + 1
    for sample in range(len(density)):
        opacity = 1 - torch.exp(-density[sample] * spacing[sample])
        colour = colour + light * opacity * rgb[sample]
        alpha = alpha + light * opacity
        depth = depth + light * opacity * depths[sample]
        light = light * (1 - opacity)
    return colour + light * background, alpha, depth


def random_rays(
    generator: torch.Generator, rays: int = 5, samples: int = 7
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    rgb = torch.rand(rays, samples, 3, generator=generator, dtype=torch.float64)
    density = 30 * torch.rand(rays, samples, generator=generator, dtype=torch.float64)
    spacing = 0.1 * torch.rand(rays, samples, generator=generator, dtype=torch.float64)
    return rgb, density, spacing, spacing.cumsum(-1)


BACKGROUND = torch.tensor([0.1, 0.6, 1.0], dtype=torch.float64)


def test_equals_the_loop(generator: torch.Generator) -> None:
    rgb, density, spacing, depths = random_rays(generator)
    found = composite(rgb, optical_depth(density, spacing, None), depths, BACKGROUND)
    for ray in range(5):
        colour, alpha, depth = loop(rgb[ray], density[ray], spacing[ray], depths[ray], BACKGROUND)
        torch.testing.assert_close(found.rgb[ray], colour)
        torch.testing.assert_close(found.alpha[ray], alpha)
        torch.testing.assert_close(found.depth[ray], depth)


def test_two_samples_by_hand() -> None:
    thickness = torch.tensor([[0.5, 1.0]]).log().neg()  # passes a half, then everything
    found = composite(
        torch.tensor([[[1.0, 0, 0], [0, 1, 0]]]), thickness, torch.tensor([[2.0, 3]]), torch.ones(3)
    )
    assert found.rgb[0].tolist() == [1.0, 0.5, 0.5]
    assert (found.alpha.item(), found.depth.item()) == (0.5, 1.0)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(-10, 1e6, width=32), min_size=1, max_size=20), st.booleans())
def test_weights_and_passing_light_sum_to_one(densities: list[float], soft: bool) -> None:
    density = torch.tensor([densities])
    likelihood = torch.linspace(0, 1.0001, density.shape[1])[None] if soft else None
    thickness = optical_depth(density, torch.full_like(density, 0.013), likelihood)
    black = composite(torch.ones(*density.shape, 3), thickness, density, torch.zeros(3))
    passing = torch.exp(-thickness.sum(-1))
    assert (black.weights.sum(-1) + passing - 1).abs().max() <= 1e-6
    assert (black.weights >= 0).all()
    assert 0 <= black.alpha.item() <= 1 + 1e-6
    white = composite(torch.ones(*density.shape, 3), thickness, density, torch.ones(3))
    assert (white.rgb - 1).abs().max() <= 2e-6


@pytest.mark.parametrize("density", [0.0, 1e-30, 1.0, 1e3, 1e6, 1e30])
@pytest.mark.parametrize("likelihood", [None, 0.0, 0.01, 1.0, 1.0001])
def test_values_and_gradients_are_finite(density: float, likelihood: float | None) -> None:
    given_density = torch.full((1, 4), density, requires_grad=True)
    mask = None if likelihood is None else torch.full((1, 4), likelihood, requires_grad=True)
    thickness = optical_depth(given_density, torch.full((1, 4), 0.01), mask)
    found = composite(torch.rand(1, 4, 3), thickness, torch.ones(1, 4), torch.zeros(3))
    torch.autograd.backward(found.rgb.sum() + found.depth.sum() + found.alpha.sum())
    assert torch.isfinite(found.rgb).all()
    assert given_density.grad is not None
    assert torch.isfinite(given_density.grad).all()
    if mask is not None:
        assert mask.grad is not None
        assert torch.isfinite(mask.grad).all()


def test_shares_so_far_are_the_weights_of_whole_rays(generator: torch.Generator) -> None:
    """And at least them where samples in front are left out."""
    thickness = torch.rand(7, 9, generator=generator) ** 4 * 5
    weights = composite(
        torch.zeros(7, 9, 3), thickness, torch.ones(7, 9), torch.zeros(3)
    ).weights.reshape(-1)
    ray = torch.arange(63) // 9
    shares = shares_so_far(thickness.reshape(-1), ray)
    torch.testing.assert_close(shares, weights, rtol=1e-5, atol=1e-7)
    some = torch.rand(63, generator=generator) < 0.6
    assert (shares_so_far(thickness.reshape(-1)[some], ray[some]) >= weights[some] - 1e-7).all()


def test_nothing_behind_what_is_opaque_has_a_share() -> None:
    """Sums over many opaque rays must not swallow the next ray's first sample."""
    thickness = torch.tensor([1e6, 1e-4] * 20000)
    ray = torch.arange(40000) // 2
    shares = shares_so_far(thickness, ray)
    assert (shares[0::2] == 1).all() and (shares[1::2] == 0).all()
    alone = shares_so_far(thickness, torch.arange(40000))
    torch.testing.assert_close(alone[1::2], torch.full((20000,), 1e-4), rtol=1e-3, atol=0)
    after = torch.cat([thickness, torch.full((2,), 0.3)])  # a ray behind many opaque ones
    ray = torch.cat([ray, torch.full((2,), 30000)])
    expected = torch.tensor([1 - math.exp(-0.3), math.exp(-0.3) - math.exp(-0.6)])
    torch.testing.assert_close(shares_so_far(after, ray)[-2:], expected)
    assert shares_so_far(torch.zeros(0), torch.zeros(0, dtype=torch.long)).shape == (0,)


def test_empty_rays_are_background() -> None:
    found = composite(torch.rand(2, 3, 3), torch.zeros(2, 3), torch.ones(2, 3), BACKGROUND.float())
    torch.testing.assert_close(found.rgb, BACKGROUND.float().expand(2, 3), rtol=0, atol=0)
    assert found.alpha.abs().max() == 0 and found.depth.abs().max() == 0
    none = composite(torch.ones(0, 3, 3), torch.ones(0, 3), torch.ones(0, 3), torch.ones(3))
    assert none.rgb.shape == (0, 3)


def test_a_soft_mask_multiplies_the_opacity() -> None:
    density, spacing = torch.tensor([[3.0]]), torch.tensor([[0.2]])
    thickness = optical_depth(density, spacing, torch.tensor([[0.25]]))
    opacity = 1 - torch.exp(-thickness)
    torch.testing.assert_close(opacity, 0.25 * (1 - torch.exp(-density * spacing)))
    full = optical_depth(density, spacing, torch.ones(1, 1))
    torch.testing.assert_close(full, density * spacing)


def test_gradient(generator: torch.Generator) -> None:
    rgb, density, spacing, depths = random_rays(generator, 2, 4)
    likelihood = torch.rand(2, 4, generator=generator, dtype=torch.float64)

    def hard(rgb: Tensor, density: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        found = composite(rgb, optical_depth(density, spacing, None), depths, BACKGROUND)
        return found.rgb, found.alpha, found.depth

    def soft(rgb: Tensor, density: Tensor, likelihood: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        found = composite(rgb, optical_depth(density, spacing, likelihood), depths, BACKGROUND)
        return found.rgb, found.alpha, found.depth

    inputs = (rgb.requires_grad_(), density.requires_grad_())
    assert gradcheck(hard, inputs)
    assert gradcheck(soft, (*inputs, likelihood.requires_grad_()))
