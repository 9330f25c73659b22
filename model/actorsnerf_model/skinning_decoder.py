"""The learned part of the skinning volume: logits that are added to the skeleton's prior."""

import itertools
import math
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

SLOPE = 0.2
"""Of the leaky ReLU after every layer but the last (released code)."""


@dataclass(frozen=True)
class SkinningDecoderConfig:
    """Which decoder, and its sizes."""

    kind: Literal["convolutions", "direct"] = "convolutions"
    """`convolutions`: the released network on a learned constant, 63.6 M parameters at the default
    sizes. `direct`: the logits themselves are the parameters, 0.8 M at 32 nodes."""
    constant: int = 256
    """Length of the learned constant (convolutions)."""
    channels: tuple[int, ...] = (1024, 512, 512, 256, 256)
    """Of the linear layer and of each convolution but the last; each convolution doubles the size,
    so five make 2^5 = 32 nodes."""
    resolution: int = 32
    """Nodes per axis (direct)."""

    @property
    def nodes(self) -> int:
        """Nodes of the volume per axis."""
        if self.kind == "direct":
            return self.resolution
        return int(2 ** len(self.channels))


class ConvolutionalSkinning(nn.Module):
    """The released decoder: a learned constant through transposed convolutions."""

    def __init__(self, config: SkinningDecoderConfig) -> None:
        super().__init__()
        self.constant = nn.Parameter(torch.randn(config.constant))
        self.linear = nn.Linear(config.constant, config.channels[0])
        widths = [*config.channels, 25]
        self.convolutions = nn.ModuleList(
            nn.ConvTranspose3d(ins, outs, kernel_size=4, stride=2, padding=1)
            for ins, outs in itertools.pairwise(widths)
        )
        gain = nn.init.calculate_gain("leaky_relu", SLOPE)
        nn.init.xavier_uniform_(self.linear.weight, gain)
        nn.init.zeros_(self.linear.bias)
        for layer, convolution in enumerate(self.convolutions):
            last = layer == len(self.convolutions) - 1
            _tied_xavier_(convolution, 1.0 if last else gain)

    def forward(self) -> Float[Tensor, "25 z y x"]:
        """The logits of all nodes."""
        activation = nn.functional.leaky_relu(self.linear(self.constant), SLOPE)
        activation = activation.reshape(1, -1, 1, 1, 1)
        for layer, convolution in enumerate(self.convolutions):
            if layer > 0:
                activation = nn.functional.leaky_relu(activation, SLOPE)
            activation = convolution(activation)
        logits: Tensor = activation[0]
        return logits


class DirectSkinning(nn.Module):
    """The logits as parameters, zero at first: the prior itself."""

    def __init__(self, config: SkinningDecoderConfig) -> None:
        super().__init__()
        size = config.resolution
        self.logits = nn.Parameter(torch.zeros(25, size, size, size))

    def forward(self) -> Float[Tensor, "25 z y x"]:
        """The logits of all nodes."""
        return self.logits


def skinning_decoder(config: SkinningDecoderConfig) -> ConvolutionalSkinning | DirectSkinning:
    """The decoder that a configuration names."""
    match config.kind:
        case "convolutions":
            return ConvolutionalSkinning(config)
        case "direct":
            return DirectSkinning(config)


def residual_size(residual: Float[Tensor, "25 z y x"]) -> Float[Tensor, ""]:
    """Mean over nodes of the channels' summed absolute logits: the skinning regulariser.

    Source: released code (weight 0.01). It pulls the volume to the prior; the paper speaks of an L1
    distance between weights and prior.
    """
    return residual.abs().sum(0).mean()


@torch.no_grad()
def _tied_xavier_(convolution: nn.Module, gain: float) -> None:
    """Xavier-uniform weights, equal within each block of two: the layer starts as an upsampling.

    With stride 2 each output sees an eighth of the kernel, and that eighth counts as the fan.
    """
    weight, bias = convolution.weight, convolution.bias
    assert isinstance(weight, Tensor) and isinstance(bias, Tensor)
    ins, outs, *kernel = weight.shape
    limit = gain * math.sqrt(6 / ((ins + outs) * math.prod(kernel) / 8))
    even = torch.empty_like(weight[:, :, ::2, ::2, ::2]).uniform_(-limit, limit)
    for axis in (2, 3, 4):
        even = even.repeat_interleave(2, axis)
    weight.copy_(even)
    bias.zero_()


__all__ = [
    "ConvolutionalSkinning",
    "DirectSkinning",
    "SkinningDecoderConfig",
    "residual_size",
    "skinning_decoder",
]
