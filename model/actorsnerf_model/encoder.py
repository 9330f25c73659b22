"""The image encoder: K support views in, feature maps at half resolution out (paper sec. 3.3).

Two trunks: ResNet-18 up to layer2 (the paper's), whose parameters have torchvision's names, and
VGG-16 up to relu3_3, whose ImageNet weights can be had offline. All K views go in one batch; the
released code encodes them one by one, which matters only to batch statistics in training.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.batch_norm import MapNorm
from actorsnerf_model.constants import constant

TRUNK_CHANNELS = {"resnet18": 256, "vgg16": 448}
"""Of the joined map: 64 + 64 + 128 (stem, layer1, layer2); 64 + 128 + 256 (three VGG blocks)."""
BLOCK = 8
"""Pixels that both trunks' strides divide."""
IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class EncoderConfig:
    """Which encoder; defaults are the released code's."""

    trunk: Literal["resnet18", "vgg16"] = "resnet18"
    weights: Literal["imagenet", "random"] = "imagenet"
    """Where the trunk's first weights come from; a result says which."""
    train_trunk: bool = True
    """Whether pre-training changes the trunk."""
    body_channels: int = 64
    """Of the reduced map that SMPL vertices read."""
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """What a support view's person stands on: black for ZJU-MoCap, white for AIST++."""


@dataclass(frozen=True)
class FeatureMap:
    """Features of K views on a grid of half the pictures' resolution."""

    table: Float[Tensor, "views height width channels"]
    first: float
    """Pixel coordinate of cell 0 in x and y."""
    stride: int = 2
    """Pixels per cell."""

    def cells(self, pixels: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 2"]:
        """Where the pixels lie on the grid, in cells.

        Exact for this trunk's strides; the released code stretches the picture's corners onto the
        map's, which is up to one cell off.
        """
        return (pixels - self.first) / self.stride


class Encoder(nn.Module):
    """A trunk, and the 1x1 reduction that SMPL vertices read."""

    def __init__(self, config: EncoderConfig, reduced: bool = True) -> None:
        """Random weights; without `reduced` there is no map for the vertices."""
        super().__init__()
        self.config = config
        self.trunk: ResNet18Trunk | VGG16Trunk
        match config.trunk:
            case "resnet18":
                self.trunk = ResNet18Trunk()
            case "vgg16":
                self.trunk = VGG16Trunk()
        self.trunk.requires_grad_(config.train_trunk)
        channels = TRUNK_CHANNELS[config.trunk]
        self.reduction = nn.Conv2d(channels, config.body_channels, 1) if reduced else None

    def forward(
        self, pictures: Float[Tensor, "views 3 height width"]
    ) -> tuple[FeatureMap, FeatureMap | None]:
        """The trunk's map and the reduced one.

        Args:
            pictures: RGB in [0, 1], the person on the configured background.
        """
        joined = self.trunk(pictures)
        trunk = FeatureMap(_channels_last(joined), self.trunk.first)
        if self.reduction is None:
            return trunk, None
        # A 1x1 convolution as the matrix product that it is: several times faster on a CPU.
        weight = self.reduction.weight.flatten(1)
        table = F.linear(trunk.table, weight, self.reduction.bias)
        return trunk, FeatureMap(table, self.trunk.first)

    def train(self, mode: bool = True) -> "Encoder":
        """Frozen trunks stay in evaluation mode, so their running statistics never move."""
        super().train(mode)
        if not self.config.train_trunk:
            self.trunk.eval()
        return self


def support_pictures(
    views: tuple[View, ...], background: tuple[float, float, float]
) -> Float[Tensor, "views 3 height width"]:
    """The views' persons on the background, one batch.

    Padded right and below to one size, a multiple of 8: intrinsics stay as they are. What of a crop
    hangs over its picture's edge is background as well; no point reads features there.
    """
    height = -(-max(view.image.shape[0] for view in views) // BLOCK) * BLOCK
    width = -(-max(view.image.shape[1] for view in views) // BLOCK) * BLOCK
    pictures = []
    for view in views:
        ground = constant(background, view.image)
        alpha = view.alpha[..., None]
        picture = view.image * alpha + ground * (1 - alpha)
        padded = ground.expand(height, width, 3).clone()
        padded[: picture.shape[0], : picture.shape[1]] = picture
        pictures.append(padded)
    return torch.stack(pictures).permute(0, 3, 1, 2)


class ResNet18Trunk(nn.Module):
    """ResNet-18's stem, layer1 and layer2, joined at the stem's resolution; input in [-1, 1]."""

    first = 0.0
    """Stem cell i is centred on pixel 2 i."""

    def __init__(self) -> None:
        """Random weights as torchvision's: Kaiming normal, fan out."""
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, stride=2, padding=3, bias=False)
        self.bn1 = MapNorm(64)
        self.layer1 = nn.Sequential(_Block(64, 64, 1), _Block(64, 64, 1))
        self.layer2 = nn.Sequential(_Block(64, 128, 2), _Block(128, 128, 1))
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(
        self, pictures: Float[Tensor, "views 3 height width"]
    ) -> Float[Tensor, "views 256 cells_high cells_wide"]:
        """The joined map; the released code also runs layer3 and layer4, which nothing reads."""
        normal = (pictures * 2 - 1).contiguous(memory_format=torch.channels_last)
        stem = F.relu(self.bn1(self.conv1(normal)))
        first = self.layer1(F.max_pool2d(stem, 3, stride=2, padding=1))
        second = self.layer2(first)
        size = stem.shape[-2:]
        return torch.cat([stem, _spread(first, 2, size), _spread(second, 4, size)], dim=1)


class _Block(nn.Module):
    """ResNet's basic block."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False)
        self.bn1 = MapNorm(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1, bias=False)
        self.bn2 = MapNorm(outputs)
        self.downsample = (
            nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride=stride, bias=False), MapNorm(outputs)
            )
            if stride > 1
            else nn.Identity()
        )

    def forward(self, x: Tensor) -> Tensor:
        inner = F.relu(self.bn1(self.conv1(x)))
        return F.relu(self.bn2(self.conv2(inner)) + self.downsample(x))


class VGG16Trunk(nn.Module):
    """VGG-16 up to relu3_3: its three blocks' last maps, joined at half resolution."""

    first = 0.5
    """A cell is the mean of pixels 2 i and 2 i + 1."""

    def __init__(self) -> None:
        """Random weights as torchvision's; `features` has torchvision's names."""
        super().__init__()
        sizes = ((3, 64), (64, 64), (64, 128), (128, 128), (128, 256), (256, 256), (256, 256))
        convolutions = [nn.Conv2d(a, b, 3, padding=1) for a, b in sizes]
        for convolution in convolutions:
            nn.init.kaiming_normal_(convolution.weight, mode="fan_out", nonlinearity="relu")
            assert convolution.bias is not None
            nn.init.zeros_(convolution.bias)
        self.features = nn.Sequential()
        for i in range(len(sizes)):
            if i in (2, 4):
                self.features.append(nn.MaxPool2d(2))
            self.features.append(convolutions[i])
            self.features.append(nn.ReLU())

    def forward(
        self, pictures: Float[Tensor, "views 3 height width"]
    ) -> Float[Tensor, "views 448 cells_high cells_wide"]:
        """The joined map; pictures are normalised by ImageNet's mean and deviation."""
        mean = constant(IMAGENET_MEAN, pictures)[:, None, None]
        deviation = constant(IMAGENET_STD, pictures)[:, None, None]
        x = ((pictures - mean) / deviation).contiguous(memory_format=torch.channels_last)
        first = self.features[:4](x)
        second = self.features[4:9](first)
        third = self.features[9:](second)
        wide = F.interpolate(third, size=second.shape[-2:], mode="bilinear", align_corners=False)
        return torch.cat([F.avg_pool2d(first, 2), second, wide], dim=1)


def _spread(
    coarse: Float[Tensor, "views channels rows columns"], factor: int, size: torch.Size
) -> Float[Tensor, "views channels height width"]:
    """The map on a grid `factor` times finer, coarse cell j exactly on fine cell factor * j.

    The released code aligns the corners of both grids instead, which moves features by up to one
    cell. Behind the last coarse cell its value is repeated.
    """
    rows, columns = coarse.shape[-2:]
    exact = (factor * (rows - 1) + 1, factor * (columns - 1) + 1)
    fine = F.interpolate(coarse, size=exact, mode="bilinear", align_corners=True)
    below, right = size[0] - exact[0], size[1] - exact[1]
    return F.pad(fine, (0, right, 0, below), mode="replicate")


def _channels_last(
    x: Float[Tensor, "views channels height width"],
) -> Float[Tensor, "views height width channels"]:
    return x.permute(0, 2, 3, 1)
