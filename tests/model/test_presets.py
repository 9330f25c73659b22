import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from actorsnerf_model.actorsnerf import ActorsNeRF, ActorsNeRFConfig
from actorsnerf_model.deformation import Deformation
from actorsnerf_model.presets import OFFICIAL, SMALL, SMALL_VGG, TINY
from actorsnerf_model.radiance import Radiance


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
    codes = torch.rand(count, config.views, config.deformation_net.code)
    pixels = torch.rand(count, config.views, config.radiance.code)
    body = torch.rand(count, config.sparse.tapped_channels)
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        net(points, 2.0, torch.zeros(24, 3), codes)
        radiance(points, pixels, body)
    return float(counter.get_total_flops()) / count / 1e6


def test_small_is_light() -> None:
    assert megaflops(SMALL) <= 0.25


def test_official_costs_little_more_than_half_of_the_plain_form() -> None:
    # The released form takes 4.543 MFLOP a point, of which pixel layers on the map save most.
    assert megaflops(OFFICIAL) < 0.57 * 4.543


@pytest.mark.parametrize("config", [SMALL, SMALL_VGG, TINY])
def test_presets_can_be_built(config: ActorsNeRFConfig) -> None:
    assert ActorsNeRF(config).config == config
