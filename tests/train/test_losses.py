import pytest
import torch

from actorsnerf_train.losses import GradientPyramid, LossWeights, Perceptual, training_losses


def patches(seed: int) -> torch.Tensor:
    return torch.rand(2, 8, 8, 3, generator=torch.Generator().manual_seed(seed))


def test_total_is_the_weighted_sum_by_hand() -> None:
    perceptual = Perceptual(None)
    prediction, target = torch.full((1, 2, 2, 3), 0.5), torch.full((1, 2, 2, 3), 0.25)
    losses = training_losses(
        prediction, target, torch.tensor(3.0), perceptual, LossWeights(1.0, 0.2, 0.01)
    )
    # constant pictures: no gradients; in [-1, 1] they are 0.5 apart at the coarsest scale
    assert losses.perceptual.item() == pytest.approx(0.5)
    assert losses.squared_error.item() == pytest.approx(0.0625)
    assert losses.total.item() == pytest.approx(0.5 + 0.2 * 0.0625 + 0.01 * 3)


def test_a_weight_of_zero_leaves_the_perceptual_term_out() -> None:
    weights = LossWeights(perceptual=0.0)
    losses = training_losses(patches(0), patches(1), torch.tensor(0.0), Perceptual(None), weights)
    assert losses.perceptual.item() == 0
    assert losses.total.item() == pytest.approx(0.2 * losses.squared_error.item())


def test_substitute_by_hand() -> None:
    prediction = torch.zeros(1, 3, 2, 2)
    target = torch.zeros(1, 3, 2, 2)
    target[..., 1] = 1.0  # a vertical edge
    # level 0: horizontal differences 1, vertical 0; level 1 is one pixel, 1/2 apart
    assert GradientPyramid()(prediction, target).item() == pytest.approx(1 / 4 + 1 / 2)


def test_substitute_is_a_distance_with_its_own_name() -> None:
    perceptual = Perceptual(None)
    assert perceptual.name == "gradient_pyramid"
    a, b = patches(2), patches(3)
    assert perceptual(a, a).item() == 0
    assert perceptual(a, b).item() == pytest.approx(perceptual(b, a).item())
    assert perceptual(a, b).item() > 0


def test_gradient_of_the_terms() -> None:
    prediction = patches(4).double().requires_grad_()
    target = patches(5).double()
    skinning = torch.tensor(0.5, dtype=torch.float64, requires_grad=True)
    perceptual = Perceptual(None)

    def total(p: torch.Tensor, s: torch.Tensor) -> torch.Tensor:
        return training_losses(p, target, s, perceptual, LossWeights()).total

    assert torch.autograd.gradcheck(total, (prediction, skinning))
