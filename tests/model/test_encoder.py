from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import pytest
import torch

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.encoder import (
    TRUNK_CHANNELS,
    Encoder,
    EncoderConfig,
    ResNet18Trunk,
    VGG16Trunk,
    support_pictures,
)

TRUNKS: tuple[Literal["resnet18", "vgg16"], ...] = ("resnet18", "vgg16")
BATCH_NORM = ("weight", "bias", "running_mean", "running_var", "num_batches_tracked")


def torchvision_names() -> set[str]:
    """Entries of torchvision's resnet18 up to layer2, written down from its published file."""
    names = {"conv1.weight", *(f"bn1.{part}" for part in BATCH_NORM)}
    for layer in ("layer1", "layer2"):
        for block in (0, 1):
            for i in (1, 2):
                names.add(f"{layer}.{block}.conv{i}.weight")
                names |= {f"{layer}.{block}.bn{i}.{part}" for part in BATCH_NORM}
    names.add("layer2.0.downsample.0.weight")
    return names | {f"layer2.0.downsample.1.{part}" for part in BATCH_NORM}


def test_resnet_has_torchvision_names() -> None:
    assert set(ResNet18Trunk().state_dict()) == torchvision_names()


def test_vgg_has_torchvision_names() -> None:
    layers = (0, 2, 5, 7, 10, 12, 14)
    expected = {f"features.{layer}.{part}" for layer in layers for part in ("weight", "bias")}
    assert set(VGG16Trunk().state_dict()) == expected


def test_released_size() -> None:
    encoder = Encoder(EncoderConfig())
    assert sum(p.numel() for p in encoder.trunk.parameters()) == 683_072
    assert encoder.reduction is not None
    assert sum(p.numel() for p in encoder.reduction.parameters()) == 16_448


@pytest.mark.parametrize("trunk", TRUNKS)
def test_maps_are_of_half_resolution(trunk: Literal["resnet18", "vgg16"]) -> None:
    encoder = Encoder(EncoderConfig(trunk=trunk, body_channels=5)).eval()
    with torch.no_grad():
        features, reduced = encoder(torch.rand(3, 3, 40, 32))
    assert features.table.shape == (3, 20, 16, TRUNK_CHANNELS[trunk])
    assert reduced is not None
    assert reduced.table.shape == (3, 20, 16, 5)


@pytest.mark.parametrize("trunk", TRUNKS)
def test_views_do_not_mix_in_evaluation(trunk: Literal["resnet18", "vgg16"]) -> None:
    encoder = Encoder(EncoderConfig(trunk=trunk, body_channels=3)).eval()
    pictures = torch.rand(3, 3, 32, 32)
    with torch.no_grad():
        together = encoder(pictures)[0].table
        alone = torch.cat([encoder(picture[None])[0].table for picture in pictures])
    torch.testing.assert_close(together, alone, atol=1e-4, rtol=1e-4)


# Of each trunk: its picture's first channel as slope and shift of a value in [0, 1], the pixel of
# cell 0, and for each group of channels how many pixels its max pools look up a rising ramp.
RAMPS = {
    "resnet18": (2.0, -1.0, 0.0, ((0, 64, 0.0), (64, 128, 2.0), (128, 256, 2.0))),
    "vgg16": (1 / 0.229, -0.485 / 0.229, 0.5, ((0, 64, 0.0), (64, 192, 0.5), (192, 448, 1.5))),
}


@pytest.mark.parametrize("trunk", TRUNKS)
def test_cells_lie_where_a_ramp_says(trunk: Literal["resnet18", "vgg16"]) -> None:
    """With kernels that copy, the map of a ramp is a ramp, whose value tells each cell's place."""
    encoder = Encoder(EncoderConfig(trunk=trunk), reduced=False).double().eval()
    for module in encoder.modules():
        if isinstance(module, torch.nn.Conv2d):
            copy = torch.zeros_like(module.weight)
            copy[:, 0, module.kernel_size[0] // 2, module.kernel_size[1] // 2] = 1
            module.weight.data = copy
    slope, shift, first, groups = RAMPS[trunk]
    ramp = 0.6 + 0.003 * torch.arange(64, dtype=torch.float64)
    with torch.no_grad():
        features, _ = encoder(ramp.expand(1, 3, 64, 64))
    cell = torch.arange(32, dtype=torch.float64)[4:-8]
    for begin, end, further in groups:
        values = features.table[0, 16, 4:-8, begin:end].mean(-1)
        gain = (values[1] - values[0]) / (2 * 0.003 * slope)
        pixels = ((values / gain - shift) / slope - 0.6) / 0.003
        torch.testing.assert_close(pixels, 2 * cell + first + further, atol=1e-6, rtol=0)
        found = features.cells((pixels - further)[:, None].expand(-1, 2))
        torch.testing.assert_close(found[:, 0], cell, atol=1e-6, rtol=0)


def test_a_frozen_trunk_stays_in_evaluation() -> None:
    encoder = Encoder(EncoderConfig(train_trunk=False))
    encoder.train()
    before = encoder.trunk.state_dict()["bn1.running_mean"].clone()
    encoder(torch.rand(3, 3, 32, 32))
    assert torch.equal(encoder.trunk.state_dict()["bn1.running_mean"], before)
    assert not any(p.requires_grad for p in encoder.trunk.parameters())
    assert encoder.reduction is not None
    assert all(p.requires_grad for p in encoder.reduction.parameters())


def test_a_learning_trunk_moves_its_statistics() -> None:
    encoder = Encoder(EncoderConfig()).train()
    before = encoder.trunk.state_dict()["bn1.running_mean"].clone()
    encoder(torch.rand(3, 3, 32, 32))
    assert not torch.equal(encoder.trunk.state_dict()["bn1.running_mean"], before)


def test_pictures_stand_on_the_background_and_are_padded(
    support_views: Callable[..., tuple[View, ...]],
) -> None:
    views = support_views(count=2, size=(20, 30))
    half = replace(views[0], alpha=torch.full_like(views[0].alpha, 0.25))
    small = replace(views[1], image=views[1].image[:10, :7], alpha=views[1].alpha[:10, :7])
    pictures = support_pictures((half, small), (1.0, 0.5, 0.0))
    assert pictures.shape == (2, 3, 32, 24)
    ground = torch.tensor([1.0, 0.5, 0.0])
    torch.testing.assert_close(
        pictures[0, :, 3, 4], 0.25 * half.image[3, 4] + 0.75 * ground, atol=1e-6, rtol=0
    )
    assert torch.equal(pictures[1, :, :10, :7].permute(1, 2, 0), small.image)
    assert torch.equal(pictures[1, :, 12, 3], ground)
    assert torch.equal(pictures[1, :, 3, 8], ground)


def test_padding_does_not_reach_far_features() -> None:
    encoder = Encoder(EncoderConfig(), reduced=False).eval()
    picture = torch.zeros(1, 3, 224, 64)
    picture[:, :, :40] = torch.rand(1, 3, 40, 64)
    with torch.no_grad():
        padded = encoder(picture)[0].table
        cut = encoder(picture[:, :, :160])[0].table
    torch.testing.assert_close(padded[:, :20], cut[:, :20], atol=1e-4, rtol=1e-4)
