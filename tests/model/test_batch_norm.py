"""Statistics of large batches in float32 against float64: torch's own are found to drift."""

import copy

import pytest
import torch
from torch import Tensor, nn

from actorsnerf_model.batch_norm import MapNorm, RowNorm
from actorsnerf_model.encoder import ResNet18Trunk
from actorsnerf_model.sparse_conv import SparseConfig, SparseNet


def batch(norm: nn.Module, generator: torch.Generator) -> Tensor:
    """Channels-last maps, mostly of one number each as of a background; or rows."""
    if isinstance(norm, RowNorm):
        return torch.randn(16_000, 8, generator=generator).relu() * 3 + 0.7
    maps = torch.rand(3, 128, 128, 8, generator=generator)
    maps[:, :, :90] = 0.3
    return maps.permute(0, 3, 1, 2)


@pytest.mark.parametrize("norm", [MapNorm(8), RowNorm(8)])
def test_statistics_and_gradients_are_exact(norm: nn.Module, generator: torch.Generator) -> None:
    norm = copy.deepcopy(norm).train()
    exact = copy.deepcopy(norm).double()
    given = batch(norm, generator)
    weight = torch.rand(given.shape, generator=generator)
    found = []
    for one, values in ((norm, given.clone()), (exact, given.double())):
        values.requires_grad_()
        made = one(values)
        (made * weight.to(made)).sum().backward()
        assert values.grad is not None
        found.append((made.detach().double(), values.grad.double()))
    (made, slope), (true, true_slope) = found
    assert (made - true).abs().max() < 5e-6
    assert (slope - true_slope).norm() < 1e-5 * true_slope.norm()
    for name, buffer in norm.named_buffers():
        torch.testing.assert_close(
            buffer.double(), dict(exact.named_buffers())[name].double(), rtol=1e-6, atol=1e-7
        )


@pytest.mark.parametrize("norm", [MapNorm(8), RowNorm(8)])
def test_the_layout_stays(norm: nn.Module, generator: torch.Generator) -> None:
    given = batch(norm, generator)
    for mode in (True, False):
        assert norm.train(mode)(given).stride() == given.stride()


def test_in_evaluation_they_are_torchs(generator: torch.Generator) -> None:
    for norm, plain in ((MapNorm(8), nn.BatchNorm2d(8)), (RowNorm(8), nn.BatchNorm1d(8))):
        assert norm.state_dict().keys() == plain.state_dict().keys()
        given = batch(norm, generator)
        assert torch.equal(norm.eval()(given), plain.eval()(given))


@pytest.mark.parametrize("network", [ResNet18Trunk(), SparseNet(SparseConfig(), 8)])
def test_all_networks_have_them(network: nn.Module) -> None:
    norms = [
        part for part in network.modules() if isinstance(part, nn.modules.batchnorm._BatchNorm)
    ]
    assert len(norms) > 5
    assert all(isinstance(norm, (MapNorm, RowNorm)) for norm in norms)
