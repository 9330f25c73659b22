import pytest
import torch
from torch import Tensor
from torch.nn import functional as F

from actorsnerf_model.fourier import fourier_features
from actorsnerf_model.radiance import Radiance, RadianceConfig

VIEWS, PIXEL, BODY = 3, 7, 5
SOFT = RadianceConfig(16, 6, 4, "softplus", 100.0, -2.0)


def plain(
    net: Radiance, points: Tensor, pixels: Tensor | None, body: Tensor | None
) -> tuple[Tensor, Tensor]:
    """The released form: the body repeated for each view, each layer for each view and point."""
    position = fourier_features(points, net.config.octaves, identity=True)
    views = pixels.shape[1] if pixels is not None else 1
    repeated = position[:, None].expand(-1, views, -1)
    parts = []
    if net.body is not None and body is not None:
        parts.append(F.relu(net.body(body[:, None].expand(-1, views, -1))))
    if net.pixel is not None and pixels is not None:
        parts.append(F.relu(net.pixel(pixels)))
    given = torch.cat(parts, dim=-1) if parts else repeated
    density = torch.cat([F.relu(net.density_0(given)), repeated], dim=-1)
    density = F.relu(net.density_1(density).mean(dim=1))
    density = net.density_out(F.relu(net.density_3(F.relu(net.density_2(density)))))[:, 0]
    colour = torch.cat([F.relu(net.colour_0(given)), repeated], dim=-1)
    colour = F.relu(net.colour_2(F.relu(net.colour_1(colour))).mean(dim=1))
    colour = torch.sigmoid(net.colour_out(F.relu(net.colour_3(colour))))
    shifted = density + net.config.density_shift
    positive = F.relu(shifted) if net.config.density == "relu" else F.softplus(shifted)
    return colour, positive * net.config.density_scale


@pytest.mark.parametrize("config", [RadianceConfig(16, 16, 4), SOFT])
@pytest.mark.parametrize("pixel", [0, PIXEL])
@pytest.mark.parametrize("body", [0, BODY])
def test_equals_the_plain_form(config: RadianceConfig, pixel: int, body: int) -> None:
    torch.manual_seed(2)
    net = Radiance(config, pixel, body)
    points = torch.rand(30, 3) * 2 - 1
    seen = torch.randn(30, VIEWS, pixel) if pixel else None
    held = torch.randn(30, body) if body else None
    projected = None
    if net.pixel is not None and seen is not None:
        projected = F.linear(seen, net.pixel.weight)
    rgb, density = net(points, projected, held)
    slow_rgb, slow_density = plain(net, points, seen, held)
    torch.testing.assert_close(rgb, slow_rgb, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(density, slow_density, atol=1e-5, rtol=1e-5)


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
    rgb, density = net(torch.randn(50, 3) * 10, None, None)
    assert bool(((rgb > 0) & (rgb < 1)).all())
    assert bool((density >= 0).all())


def test_view_order_does_not_matter() -> None:
    torch.manual_seed(3)
    net = Radiance(RadianceConfig(8, 8, 2), PIXEL, 0).double()
    points, pixels = torch.rand(6, 3).double(), torch.randn(6, VIEWS, 8).double()
    rgb, density = net(points, pixels, None)
    turned_rgb, turned_density = net(points, pixels.roll(1, dims=1), None)
    torch.testing.assert_close(rgb, turned_rgb)
    torch.testing.assert_close(density, turned_density)


def test_no_points() -> None:
    rgb, density = Radiance(SOFT, 0, BODY)(torch.zeros(0, 3), None, torch.zeros(0, BODY))
    assert rgb.shape == (0, 3)
    assert density.shape == (0,)
