from functools import partial

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_model import pieces
from actorsnerf_model.deformation import Deformation, DeformationConfig

VIEWS = 3


def rearranged(
    net: Deformation, points: Tensor, opened: float, pose: Tensor, pixels: Tensor | None
) -> Tensor:
    """The offsets by `point_input` and `from_input`."""
    codes = None
    if net.pixel_code is not None and pixels is not None:
        codes = F.linear(pixels, net.pixel_code.weight)
    return net.from_input(net.point_input(points, opened, codes), pose)


class Rearranged(nn.Module):
    """A net that is called in the order of `rearranged`."""

    def __init__(self, net: Deformation) -> None:
        super().__init__()
        self.net = net

    def forward(self, points: Tensor, opened: float, pose: Tensor, pixels: Tensor | None) -> Tensor:
        return rearranged(self.net, points, opened, pose, pixels)


def made(config: DeformationConfig, channels: int, dtype: torch.dtype) -> Deformation:
    torch.manual_seed(1)
    net = Deformation(config, channels, VIEWS).to(dtype)
    torch.nn.init.normal_(net.offset.weight)
    return net


def test_tiles_add_up_to_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "TILE", 7)
    net = made(DeformationConfig(width=16, depth=4, skip=2, octaves=3, code=5), 10, torch.float32)
    arguments = (torch.rand(30, 3), 3.0, torch.randn(24, 3), torch.randn(VIEWS, 30, 10))
    whole = rearranged(net, *arguments)
    with torch.no_grad():
        tiled = rearranged(net, *arguments)
    torch.testing.assert_close(tiled, whole, atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("channels", [0, 10])
def test_equals_the_published_order(channels: int) -> None:
    net = made(
        DeformationConfig(width=16, depth=4, skip=2, octaves=3, code=5), channels, torch.float32
    )
    points, pose = torch.rand(20, 3) * 2 - 1, torch.randn(24, 3)
    pixels = torch.randn(VIEWS, 20, channels) if channels else None
    fast = rearranged(net, points, 1.7, pose, pixels)
    torch.testing.assert_close(fast, net(points, 1.7, pose, pixels), atol=1e-5, rtol=1e-5)


def test_released_size() -> None:
    net = Deformation(DeformationConfig(), 256, VIEWS)
    assert sum(p.numel() for p in net.parameters()) == 175_555
    assert net.hidden[0].weight.shape == (128, 297)
    assert net.hidden[4].weight.shape == (128, 425)


def test_starts_near_zero() -> None:
    net = Deformation(DeformationConfig(), 8, VIEWS)
    assert float(net.offset.weight.detach().abs().max()) <= 1e-5
    offsets = net(torch.rand(9, 3), 6.0, torch.randn(24, 3), torch.randn(VIEWS, 9, 8))
    assert float(offsets.detach().abs().max()) < 1e-2


def test_root_rotation_is_ignored_and_other_joints_are_not() -> None:
    net = made(DeformationConfig(width=16, depth=3, skip=1, octaves=2), 0, torch.float64)
    points, pose = torch.rand(4, 3, dtype=torch.float64), torch.zeros(24, 3, dtype=torch.float64)
    turned, bent = pose.clone(), pose.clone()
    turned[0], bent[5] = 1.0, 1.0
    at_rest = rearranged(net, points, 2.0, pose, None)
    assert torch.equal(rearranged(net, points, 2.0, turned, None), at_rest)
    assert not torch.allclose(rearranged(net, points, 2.0, bent, None), at_rest)


def test_view_order_matters() -> None:
    net = made(DeformationConfig(width=16, depth=3, skip=1, octaves=2, code=4), 4, torch.float64)
    points, pose = torch.rand(4, 3, dtype=torch.float64), torch.zeros(24, 3, dtype=torch.float64)
    pixels = torch.randn(VIEWS, 4, 4, dtype=torch.float64)
    seen = rearranged(net, points, 2.0, pose, pixels)
    assert not torch.allclose(seen, rearranged(net, points, 2.0, pose, pixels.flip(0)))


@pytest.mark.parametrize("published", [True, False])
def test_gradient(published: bool) -> None:
    own = made(DeformationConfig(width=8, depth=3, skip=1, octaves=2, code=2), 3, torch.float64)
    net = own if published else Rearranged(own)
    points = torch.rand(2, 3, dtype=torch.float64, requires_grad=True)
    pose = torch.randn(24, 3, dtype=torch.float64, requires_grad=True)
    pixels = torch.randn(VIEWS, 2, 3, dtype=torch.float64, requires_grad=True)
    names = [name for name, _ in net.named_parameters()]
    values = [p.detach().clone().requires_grad_() for p in net.parameters()]

    def run(points: Tensor, pose: Tensor, pixels: Tensor, *values: Tensor) -> Tensor:
        state = dict(zip(names, values, strict=True))
        result = torch.func.functional_call(net, state, (points, 1.3, pose, pixels))
        assert isinstance(result, Tensor)
        return result

    given = (points, pose, pixels, *values)
    # a layer whose units are all off would hide every mistake behind zeros
    assert all(grad.any() for grad in torch.autograd.grad(run(*given).sum(), given))
    assert torch.autograd.gradcheck(run, given)


def test_no_points() -> None:
    net = made(DeformationConfig(width=4, depth=2, skip=1), 0, torch.float32)
    for run in (net, partial(rearranged, net)):
        assert run(torch.zeros(0, 3), 6.0, torch.zeros(24, 3), None).shape == (0, 3)
