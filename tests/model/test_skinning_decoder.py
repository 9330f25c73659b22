import math

import pytest
import torch

from actorsnerf_model.skinning_decoder import (
    SkinningDecoderConfig,
    residual_size,
    skinning_decoder,
)

SMALL = SkinningDecoderConfig(constant=8, channels=(12, 6, 4))


def test_the_official_sizes() -> None:
    with torch.device("meta"):
        decoder = skinning_decoder(SkinningDecoderConfig())
    assert sum(parameter.numel() for parameter in decoder.parameters()) == 63_589_145


def test_the_convolutions_double_the_grid() -> None:
    logits = skinning_decoder(SMALL)()
    assert logits.shape == (25, 8, 8, 8)
    assert torch.isfinite(logits).all() and logits.abs().max() > 0


def test_blocks_of_two_start_equal() -> None:
    decoder = skinning_decoder(SMALL)
    weight = decoder.get_parameter("convolutions.0.weight")
    assert weight.shape == (12, 6, 4, 4, 4)
    blocks = weight.reshape(12, 6, 2, 2, 2, 2, 2, 2)
    for offset in torch.cartesian_prod(*[torch.arange(2)] * 3).tolist():
        part = blocks[:, :, :, offset[0], :, offset[1], :, offset[2]]
        assert torch.equal(part, weight[:, :, ::2, ::2, ::2])
    gain = math.sqrt(2 / (1 + 0.2**2))
    limit = gain * math.sqrt(6 / ((12 + 6) * 8))
    assert 0.9 * limit < weight.abs().max() <= limit


def test_every_parameter_learns() -> None:
    decoder = skinning_decoder(SMALL)
    torch.autograd.backward(residual_size(decoder()))
    for parameter in decoder.parameters():
        assert parameter.grad is not None and parameter.grad.abs().max() > 0


def test_direct_logits_start_as_the_prior() -> None:
    decoder = skinning_decoder(SkinningDecoderConfig(kind="direct", resolution=4))
    logits = decoder()
    assert logits.shape == (25, 4, 4, 4) and logits.abs().max() == 0
    assert logits.requires_grad


def test_the_regulariser_by_hand() -> None:
    residual = torch.zeros(25, 1, 1, 2)
    residual[:, 0, 0, 0] = -2.0
    assert residual_size(residual).item() == pytest.approx(25.0)
