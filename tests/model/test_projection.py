import torch
from torch.autograd import gradcheck

from actorsnerf_model.projection import NEAR_PLANE, project

K = torch.tensor([[100.0, 2.0, 31.5], [0.0, 110.0, 23.5], [0.0, 0.0, 1.0]], dtype=torch.float64)


def camera() -> torch.Tensor:
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3] = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    matrix[:3, 3] = torch.tensor([0.1, 0.2, 2.0])
    return matrix


def test_by_hand() -> None:
    seen = project(torch.tensor([[1.0, 0.3, 0.4]], dtype=torch.float64), K, camera())
    # In the camera: (0.4 + 0.1, 0.3 + 0.2, -1 + 2) = (0.5, 0.5, 1).
    expected = torch.tensor([[100 * 0.5 + 2 * 0.5 + 31.5, 110 * 0.5 + 23.5]], dtype=torch.float64)
    torch.testing.assert_close(seen.pixels, expected)
    torch.testing.assert_close(seen.depth, torch.tensor([1.0], dtype=torch.float64))
    assert seen.in_front.tolist() == [True]


def test_value_and_gradient_are_finite_at_and_behind_the_camera() -> None:
    depths = torch.tensor([-5.0, -1e-9, 0.0, 1e-12, NEAR_PLANE, 1.0], dtype=torch.float32)
    points = torch.stack([torch.full_like(depths, 0.3), torch.zeros_like(depths), depths], -1)
    points.requires_grad_()
    seen = project(points, K.float(), torch.eye(4))
    torch.autograd.backward(seen.pixels.sum())
    assert points.grad is not None
    assert torch.isfinite(seen.pixels).all() and torch.isfinite(points.grad).all()
    assert seen.in_front.tolist() == [False] * 5 + [True]


def test_gradient(generator: torch.Generator) -> None:
    points = torch.randn(6, 3, generator=generator, dtype=torch.float64)
    points[:, 0] -= 1  # some in front, some behind
    points = (0.5 * points).requires_grad_()
    assert gradcheck(lambda given: project(given, K, camera()).pixels, (points,))


def test_many_views_at_once(generator: torch.Generator) -> None:
    points = torch.randn(2, 5, 3, generator=generator, dtype=torch.float64)
    cameras = torch.stack([camera(), torch.eye(4, dtype=torch.float64)])
    seen = project(points, torch.stack([K, 2 * K]), cameras)
    alone = project(points[1], 2 * K, cameras[1])
    torch.testing.assert_close(seen.pixels[1], alone.pixels)
    assert torch.equal(seen.in_front[1], alone.in_front)


def test_half_precision_elsewhere_does_not_reach_it() -> None:
    points = torch.tensor([[0.123456, 0.234567, 1.0]])
    with torch.autocast("cpu", dtype=torch.bfloat16):
        seen = project(points, K.float(), torch.eye(4))
    expected = project(points.double(), K, torch.eye(4, dtype=torch.float64))
    assert (seen.pixels - expected.pixels).abs().max() < 1e-4
