from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.nn import functional as F

from actorsnerf_model.fourier import fourier_features
from actorsnerf_model.view_field import ViewField, ViewFieldConfig, mean_direction

CONFIG = ViewFieldConfig(
    width=12, colour_width=7, latent=5, octaves=3, direction_octaves=2, density="softplus"
)


@pytest.fixture
def network() -> ViewField:
    torch.manual_seed(4)
    return ViewField(CONFIG, 6).double()


@pytest.fixture
def given(generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Features, points, directions and a frame's numbers."""
    features = torch.randn(9, 6, generator=generator, dtype=torch.float64)
    points = torch.randn(9, 3, generator=generator, dtype=torch.float64)
    directions = F.normalize(torch.randn(9, 3, generator=generator, dtype=torch.float64))
    latent = torch.randn(5, generator=generator, dtype=torch.float64)
    return features, points, directions, latent


def plain(
    network: ViewField, features: Tensor, points: Tensor, directions: Tensor, latent: Tensor
) -> tuple[Tensor, Tensor]:
    """Colour and density as released: layer after layer, the frame's numbers at every point."""
    hidden = features
    for layer in (network.density_0, network.density_1, network.density_2):
        hidden = F.relu(layer(hidden))
    density = F.softplus(network.density_out(hidden)[:, 0])
    framed = torch.cat([network.feature(hidden), latent.expand(len(points), -1)], 1)
    seen = fourier_features(directions, 2, identity=True)
    place = fourier_features(points, 3, identity=True)
    last = torch.cat([network.framed(framed), seen, place], 1)
    colour = network.colour_out(F.relu(network.colour(last)))
    return torch.sigmoid(colour), density


def test_the_joined_layers_are_the_released_ones(
    network: ViewField, given: tuple[Tensor, Tensor, Tensor, Tensor]
) -> None:
    features, points, directions, latent = given
    rgb, density = plain(network, *given)
    hidden = network.hidden(features)
    found = network.rgb(hidden, points, directions, latent)
    torch.testing.assert_close(found, rgb, rtol=0, atol=1e-12)
    torch.testing.assert_close(network.density(hidden, torch.float64), density, rtol=0, atol=1e-12)
    expected = torch.autograd.grad(rgb.square().sum(), network.framed.weight)[0]
    gradient = torch.autograd.grad(found.square().sum(), network.framed.weight)[0]
    torch.testing.assert_close(gradient, expected, rtol=0, atol=1e-12)


def test_gradients(network: ViewField, given: tuple[Tensor, Tensor, Tensor, Tensor]) -> None:
    features, points, directions, latent = given
    for tensor in (features, directions, latent):
        tensor.requires_grad_()

    def both(features: Tensor, directions: Tensor, latent: Tensor) -> tuple[Tensor, Tensor]:
        hidden = network.hidden(features)
        density = network.density(hidden, torch.float64)
        return network.rgb(hidden, points, directions, latent), density

    assert torch.autograd.gradcheck(both, (features, directions, latent))


def test_density_depends_on_neither_side_nor_frame_but_colour_on_both(
    network: ViewField, given: tuple[Tensor, Tensor, Tensor, Tensor]
) -> None:
    features, points, directions, latent = given
    hidden = network.hidden(features)
    first = network.rgb(hidden, points, directions, latent)
    assert (network.rgb(hidden, points, -directions, latent) - first).abs().amax(1).min() > 1e-4
    assert (network.rgb(hidden, points, directions, -latent) - first).abs().amax(1).min() > 1e-4
    assert (network.rgb(hidden, -points, directions, latent) - first).abs().amax(1).min() > 1e-4


def test_without_a_side_the_encoding_is_the_mean_over_all(generator: torch.Generator) -> None:
    directions = F.normalize(torch.randn(200_000, 3, generator=generator, dtype=torch.float64))
    expected = fourier_features(directions, 4, identity=True).mean(0)
    found = torch.tensor(mean_direction(4), dtype=torch.float64)
    torch.testing.assert_close(found, expected, rtol=0, atol=0.01)


def test_the_mean_encoding_is_what_the_colour_reads(
    network: ViewField, given: tuple[Tensor, Tensor, Tensor, Tensor]
) -> None:
    features, points, _, latent = given
    hidden = network.hidden(features)
    found = network.rgb(hidden, points, None, latent)
    with torch.no_grad():
        share = network.colour.weight[:, CONFIG.width : CONFIG.width + 15]
        network.colour.bias.add_(share @ torch.tensor(mean_direction(2), dtype=torch.float64))
        share.zero_()
    torch.testing.assert_close(found, network.rgb(hidden, points, points, latent))


def test_released_sizes() -> None:
    with torch.device("meta"):
        network = ViewField(ViewFieldConfig(), 352)
    expected = (352 + 1) * 256 + 3 * (256 + 1) * 256 + (256 + 1)  # density, and the feature layer
    expected += (384 + 1) * 256 + (346 + 1) * 128 + (128 + 1) * 3
    assert sum(parameter.numel() for parameter in network.parameters()) == expected


@pytest.mark.parametrize(("kind", "expected"), [("relu", 0.0), ("softplus", 100 * 0.126928)])
def test_density_is_made_positive_as_in_the_other_methods(kind: str, expected: float) -> None:
    config = replace(CONFIG, density=kind, density_scale=100.0, density_shift=-2.0)  # type: ignore[arg-type]
    network = ViewField(config, 6)
    with torch.no_grad():
        network.density_out.weight.zero_()
        network.density_out.bias.zero_()
        found = network.density(torch.ones(1, 12), torch.float32)
    assert found.item() == pytest.approx(expected, abs=1e-3)
