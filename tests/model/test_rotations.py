import math

import numpy as np
import pytest
import torch
from torch.autograd import gradcheck

from actorsnerf_datasets.rotations import matrix_from_axis_angle as numpy_twin
from actorsnerf_model.rotations import matrix_from_axis_angle

HARD_ANGLES = [
    *(0.0, 1e-12, 1e-8, 1e-4, 0.0999, 0.1, 0.1001, 1.0),
    *(math.pi - 1e-6, math.pi, math.pi + 1e-6, 2 * math.pi, 9.0, 40.0),
]


def vectors(generator: torch.Generator, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    axes = torch.randn(len(HARD_ANGLES), 20, 3, generator=generator, dtype=torch.float64)
    axes[:, :3] = torch.eye(3, dtype=torch.float64)
    axes = axes / axes.norm(dim=-1, keepdim=True)
    angles = torch.tensor(HARD_ANGLES, dtype=torch.float64)
    scaled: torch.Tensor = axes * angles[:, None, None]
    return scaled.to(dtype)


def test_a_quarter_turn_about_z() -> None:
    turned = matrix_from_axis_angle(torch.tensor([0.0, 0.0, math.pi / 2], dtype=torch.float64))
    expected = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=torch.float64)
    torch.testing.assert_close(turned, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-6), (torch.float64, 1e-12)])
def test_orthogonal_at_every_angle(
    generator: torch.Generator, dtype: torch.dtype, tolerance: float
) -> None:
    matrix = matrix_from_axis_angle(vectors(generator, dtype))
    identity = torch.eye(3, dtype=dtype).expand_as(matrix)
    assert (matrix @ matrix.transpose(-1, -2) - identity).abs().max() <= tolerance
    assert (torch.linalg.det(matrix) - 1).abs().max() <= tolerance


def test_equals_the_numpy_twin(generator: torch.Generator) -> None:
    given = vectors(generator)
    found = matrix_from_axis_angle(given).numpy()
    np.testing.assert_allclose(found, numpy_twin(given.numpy()), rtol=0, atol=1e-14)


def test_equals_the_matrix_exponential(generator: torch.Generator) -> None:
    given = vectors(generator).reshape(-1, 3)
    x, y, z = given.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
    expected = torch.linalg.matrix_exp(cross)
    torch.testing.assert_close(matrix_from_axis_angle(given), expected, rtol=0, atol=1e-11)


def test_gradient_is_exact_at_every_angle(generator: torch.Generator) -> None:
    given = vectors(generator)[:, :4].reshape(-1, 3).requires_grad_()
    assert gradcheck(matrix_from_axis_angle, (given,))


def test_gradient_at_rest_is_the_generator_of_rotations() -> None:
    still = torch.zeros(3, dtype=torch.float64)
    jacobian = torch.func.jacrev(matrix_from_axis_angle)(still)
    about_x = torch.tensor([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=torch.float64)
    torch.testing.assert_close(jacobian[..., 0], about_x, rtol=0, atol=0)


def test_float32_gradient_is_finite_everywhere(generator: torch.Generator) -> None:
    given = vectors(generator, torch.float32).requires_grad_()
    torch.autograd.backward(matrix_from_axis_angle(given).sum())
    assert given.grad is not None
    assert torch.isfinite(given.grad).all()
