import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from actorsnerf_model.actorsnerf import ActorsNeRF, ActorsNeRFConfig
from actorsnerf_model.deformation import Deformation
from actorsnerf_model.neuralbody import NeuralBody, NeuralBodyConfig
from actorsnerf_model.presets import (
    NEURALBODY_OFFICIAL,
    NEURALBODY_OFFICIAL_SHORT,
    NEURALBODY_SMALL,
    NEURALBODY_TINY,
    OFFICIAL,
    SMALL,
    SMALL_VGG,
    TINY,
)
from actorsnerf_model.radiance import Radiance
from actorsnerf_model.view_field import ViewField


def parameters(method: ActorsNeRF) -> dict[str, int]:
    return {
        name: sum(p.numel() for p in part.parameters()) for name, part in method.named_children()
    }


def test_official_has_the_released_sizes() -> None:
    with torch.device("meta"):
        method = ActorsNeRF(OFFICIAL)
    assert parameters(method) == {
        "encoder": 683_072 + 16_448,
        "skinning": 63_589_145,
        "deformation": 175_555,
        "sparse": 2_875_840,
        "radiance": 822_276,
    }


def megaflops(config: ActorsNeRFConfig) -> float:
    """Of one point in deformation and rendering."""
    net = Deformation(config.deformation_net, 256, config.views)
    radiance = Radiance(config.radiance, 256, config.sparse.tapped_channels)
    points, count = torch.rand(100, 3), 100
    codes = torch.rand(config.views, count, config.deformation_net.code)
    pixels = torch.rand(config.views, count, config.radiance.code)
    body = torch.rand(count, config.sparse.tapped_channels)
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        net.from_input(net.point_input(points, 2.0, codes), torch.zeros(24, 3))
        features = radiance.features(points, pixels, body)
        radiance.density(features)
        radiance.colour(features)
    return float(counter.get_total_flops()) / count / 1e6


def published_megaflops(config: ActorsNeRFConfig) -> float:
    """The same in the published order of operations."""
    net = Deformation(config.deformation_net, 256, config.views)
    radiance = Radiance(config.radiance, 256, config.sparse.tapped_channels)
    points, count = torch.rand(100, 3), 100
    pixels = torch.rand(config.views, count, 256)
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        net(points, 2.0, torch.zeros(24, 3), pixels)
        radiance(points, pixels, torch.rand(count, config.sparse.tapped_channels))
    return float(counter.get_total_flops()) / count / 1e6


def test_small_is_light() -> None:
    assert megaflops(SMALL) <= 0.25


def test_official_costs_little_more_than_half_of_the_published_order() -> None:
    # Pixel layers on the map save most.
    assert published_megaflops(OFFICIAL) == pytest.approx(4.543, abs=0.05)
    assert megaflops(OFFICIAL) < 0.57 * published_megaflops(OFFICIAL)


def neuralbody_megaflops(config: NeuralBodyConfig) -> float:
    """Of one point in both networks."""
    features, count = config.sparse.tapped_channels, 10_000
    network = ViewField(config.field, features)
    points, latent = torch.rand(count, 3), torch.rand(config.field.latent)
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        hidden = network.hidden(torch.rand(count, features))
        network.density(hidden, torch.float32)
        network.rgb(hidden, points, points, latent)
    return float(counter.get_total_flops()) / count / 1e6


def test_neural_body_has_the_released_sizes() -> None:
    sparse = NEURALBODY_OFFICIAL.sparse
    assert (sparse.voxel, sparse.tapped_channels) == (0.005, 352)
    with torch.device("meta"):
        method = NeuralBody(NEURALBODY_OFFICIAL)
    convolutions = [p for name, p in method.named_parameters() if name.endswith("weight")]
    kernels = [tuple(p.shape[1:]) for p in convolutions if p.shape[0] == 27]
    assert kernels == [
        *[(16, 16)] * 2,
        *[(16, 32), (32, 32), (32, 32)],
        *[(32, 64), (64, 64), (64, 64), (64, 64)],
        *[(64, 128), (128, 128), (128, 128), (128, 128)],
        *[(128, 128)] * 4,
    ]
    assert method.codes.vertices.shape == (6890, 16)
    short = NEURALBODY_OFFICIAL_SHORT
    assert short.sparse == sparse
    assert (short.field.width, short.field.latent) == (256, 128)
    assert short.field.density == "softplus"


def test_neural_body_is_as_light_as_the_others() -> None:
    """Three of its matrices are one: the plain form takes 0.79 MFLOP at the released sizes."""
    assert neuralbody_megaflops(NEURALBODY_OFFICIAL) == pytest.approx(0.53, abs=0.02)
    assert neuralbody_megaflops(NEURALBODY_SMALL) == pytest.approx(megaflops(SMALL), rel=0.1)
    assert neuralbody_megaflops(NEURALBODY_TINY) < 0.05


@pytest.mark.parametrize("config", [SMALL, SMALL_VGG, TINY])
def test_presets_can_be_built(config: ActorsNeRFConfig) -> None:
    assert ActorsNeRF(config).config == config
