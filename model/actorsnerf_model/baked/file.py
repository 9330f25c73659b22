"""A baked actor as one safetensors file: tables, and what is known about them as text.

Codes stay bytes, the skinning weights and what nodes add to layers are rounded to float16 before
they are used, so a file gives exactly the actor that was written.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import safetensors
import safetensors.torch
import torch
from torch import Tensor

from actorsnerf_datasets.errors import UserError
from actorsnerf_model.baked.actor import BakedActorData
from actorsnerf_model.baked.bricks import BrickGrid
from actorsnerf_model.baked.offset_nodes import Layer, OffsetNodes
from actorsnerf_model.skinning import SkinningVolume

SUFFIX = ".safetensors"
FORMAT = "actorsnerf-baked-actor"
FORMAT_VERSION = 1
_HALF = ("skinning.weights", "offsets.given")


class BakedFileError(UserError):
    """A file is no baked actor that this program can read."""


@dataclass(frozen=True)
class BakedFile:
    """What a file holds."""

    data: BakedActorData
    record: Mapping[str, str]
    """Text that was given with it."""


def write_baked(path: Path, data: BakedActorData, record: Mapping[str, str]) -> None:
    """Write the file; it has its name only once it is complete.

    Args:
        path: of the file.
        data: the actor.
        record: text to keep with it; no key may start with "format".
    """
    tensors, numbers = _parts(data)
    stored = {
        name: _own(tensor.half() if name in _HALF else tensor) for name, tensor in tensors.items()
    }
    about = {"format": FORMAT, "format_version": str(FORMAT_VERSION)}
    content = safetensors.torch.save(stored, {**record, **about, "numbers": json.dumps(numbers)})
    part = path.with_name(path.name + ".part")
    with part.open("wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(path)


def read_baked(path: Path, device: torch.device) -> BakedFile:
    """The actor of a file.

    Raises:
        BakedFileError: no such file, no baked actor, or one of a newer version.
    """
    if not path.is_file():
        raise BakedFileError(
            f"{path}: no such file; bake an actor first: python -m actorsnerf_train bake --help"
        )
    about = _metadata(path)
    if about.get("format") != FORMAT:
        raise BakedFileError(
            f"{path}: is no baked actor (its format is {about.get('format')!r}, not {FORMAT!r}): "
            "bake a few-shot checkpoint first: python -m actorsnerf_train bake --help"
        )
    version = about.get("format_version", "")
    if not version.isdigit() or int(version) > FORMAT_VERSION:
        raise BakedFileError(
            f"{path}: is a baked actor of version {version}, this program reads up to "
            f"{FORMAT_VERSION}: use the version of the program that wrote it, or a newer one."
        )
    stored = safetensors.torch.load_file(path, device=str(device))
    tensors = {name: t.float() if name in _HALF else t for name, t in stored.items()}
    try:
        data = _whole(tensors, json.loads(about["numbers"]))
    except (KeyError, IndexError, ValueError) as error:
        raise BakedFileError(
            f"{path}: lacks a part of a baked actor ({error}): damaged file; bake it again."
        ) from None
    own = ("format", "format_version", "numbers")
    return BakedFile(data, {name: text for name, text in about.items() if name not in own})


def _metadata(path: Path) -> dict[str, str]:
    try:
        with safetensors.safe_open(path, "pt") as stored:
            return stored.metadata() or {}
    except safetensors.SafetensorError as error:
        raise BakedFileError(
            f"{path}: is not readable as safetensors ({error}): damaged or not complete?"
        ) from None


def _parts(data: BakedActorData) -> tuple[dict[str, Tensor], dict[str, object]]:
    """Everything as tensors and as numbers."""
    field, offsets = data.field, data.offsets
    tensors = {
        "canonical_joints": data.canonical_joints,
        "home_pose": data.home_pose,
        "home_joints": data.home_joints,
        "skinning.weights": data.skinning.weights,
        "skinning.box": data.skinning.box,
        "field.low": field.low,
        "field.index": field.index,
        "field.codes": field.codes,
    }
    numbers: dict[str, object] = {
        "threshold": data.threshold,
        "voxel": field.voxel,
        "top": field.top,
        "offsets": None,
    }
    if offsets is not None:
        tensors |= {
            "offsets.low": offsets.low,
            "offsets.nodes": offsets.nodes,
            "offsets.given": offsets.given,
            "offsets.mean": offsets.mean,
        }
        for number, layer in enumerate(offsets.layers):
            tensors[f"offsets.{number}.weight"] = layer.weight
            tensors[f"offsets.{number}.pose"] = layer.pose
            tensors[f"offsets.{number}.bias"] = layer.bias
        numbers["offsets"] = {
            "spacing": offsets.spacing,
            "sizes": offsets.sizes,
            "readers": offsets.readers,
            "layers": len(offsets.layers),
        }
    return tensors, numbers


def _own(tensor: Tensor) -> Tensor:
    """The tensor on the CPU, in memory that it shares with no other."""
    return tensor.detach().cpu().clone(memory_format=torch.contiguous_format)


def _whole(tensors: dict[str, Tensor], numbers: dict[str, object]) -> BakedActorData:
    """The reverse of `_parts`."""
    about = numbers["offsets"]
    offsets = None
    if isinstance(about, dict):
        layers = tuple(
            Layer(*(tensors[f"offsets.{number}.{part}"] for part in ("weight", "pose", "bias")))
            for number in range(about["layers"])
        )
        z, y, x = about["sizes"]
        offsets = OffsetNodes(
            tensors["offsets.low"],
            about["spacing"],
            (z, y, x),
            tensors["offsets.nodes"],
            tensors["offsets.given"],
            tuple(about["readers"]),
            layers,
            tensors["offsets.mean"],
        )
    return BakedActorData(
        tensors["canonical_joints"],
        SkinningVolume(tensors["skinning.weights"], tensors["skinning.box"]),
        offsets,
        BrickGrid(
            tensors["field.low"],
            _number(numbers["voxel"]),
            tensors["field.index"],
            tensors["field.codes"],
            _number(numbers["top"]),
        ),
        _number(numbers["threshold"]),
        tensors["home_pose"],
        tensors["home_joints"],
    )


def _number(value: object) -> float:
    if not isinstance(value, int | float):
        raise ValueError(f"{value!r} is no number")
    return float(value)


__all__ = ["SUFFIX", "BakedFile", "BakedFileError", "read_baked", "write_baked"]
