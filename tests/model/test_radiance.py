from functools import partial

import pytest
import torch
from torch import Tensor
from torch.nn import functional as F

from actorsnerf_model import pieces
from actorsnerf_model.radiance import Radiance, RadianceConfig

VIEWS, PIXEL, BODY = 3, 7, 5
SOFT = RadianceConfig(16, 6, 4, "softplus", 100.0, -2.0)


def rearranged(
    net: Radiance, points: Tensor, pixels: Tensor | None, body: Tensor | None
) -> tuple[Tensor, Tensor]:
    """Colour and density by `features`, `colour` and `density`."""
    projected = None
    if net.pixel is not None and pixels is not None:
        projected = F.linear(pixels, net.pixel.weight)
    features = net.features(points, projected, body)
    return net.colour(features), net.density(features)


@pytest.mark.parametrize("config", [RadianceConfig(16, 16, 4), SOFT])
@pytest.mark.parametrize("pixel", [0, PIXEL])
@pytest.mark.parametrize("body", [0, BODY])
def test_equals_the_published_order(config: RadianceConfig, pixel: int, body: int) -> None:
    torch.manual_seed(2)
    net = Radiance(config, pixel, body)
    points = torch.rand(30, 3) * 2 - 1
    seen = torch.randn(VIEWS, 30, pixel) if pixel else None
    held = torch.randn(30, body) if body else None
    rgb, density = rearranged(net, points, seen, held)
    slow_rgb, slow_density = net(points, seen, held)
    torch.testing.assert_close(rgb, slow_rgb, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(density, slow_density, atol=1e-5, rtol=1e-5)


def test_tiles_add_up_to_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "TILE", 7)
    torch.manual_seed(4)
    net = Radiance(SOFT, PIXEL, BODY)
    points, seen, held = torch.rand(30, 3), torch.randn(VIEWS, 30, PIXEL), torch.randn(30, BODY)
    whole = rearranged(net, points, seen, held)
    with torch.no_grad():
        tiled = rearranged(net, points, seen, held)
    torch.testing.assert_close(tiled, whole, atol=1e-6, rtol=1e-5)


def test_released_size() -> None:
    net = Radiance(RadianceConfig(), 256, 256)
    assert sum(p.numel() for p in net.parameters()) == 822_276


def test_without_a_feature_its_layer_does_not_exist() -> None:
    net = Radiance(RadianceConfig(), 0, 256)
    assert net.pixel is None
    assert net.density_0.weight.shape == (256, 256)
    assert Radiance(RadianceConfig(), 0, 0).density_0.weight.shape == (256, 63)


def test_ranges() -> None:
    net = Radiance(SOFT, 0, 0)
    rgb, density = rearranged(net, torch.randn(50, 3) * 10, None, None)
    assert bool(((rgb > 0) & (rgb < 1)).all())
    assert bool((density >= 0).all())


def test_view_order_does_not_matter() -> None:
    torch.manual_seed(3)
    net = Radiance(RadianceConfig(8, 8, 2), PIXEL, 0).double()
    points, pixels = torch.rand(6, 3).double(), torch.randn(VIEWS, 6, PIXEL).double()
    for run in (net, partial(rearranged, net)):
        rgb, density = run(points, pixels, None)
        turned_rgb, turned_density = run(points, pixels.roll(1, dims=0), None)
        torch.testing.assert_close(rgb, turned_rgb)
        torch.testing.assert_close(density, turned_density)


def test_no_points() -> None:
    net = Radiance(SOFT, 0, BODY)
    for run in (net, partial(rearranged, net)):
        rgb, density = run(torch.zeros(0, 3), None, torch.zeros(0, BODY))
        assert rgb.shape == (0, 3)
        assert density.shape == (0,)
