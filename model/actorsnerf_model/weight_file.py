"""Published weights as files of the user's: read without running anything that they hold."""

import struct
from pathlib import Path
from pickle import UnpicklingError

import safetensors.torch
import torch
from safetensors import SafetensorError
from torch import Tensor

from actorsnerf_datasets.errors import UserError

UNREADABLE = (
    *(SafetensorError, UnpicklingError, struct.error),
    *(RuntimeError, OSError, EOFError, ValueError, LookupError),
)
"""What the readers of weights raise on other files' bytes."""


class WeightsError(UserError):
    """A weight file is missing, or not what it claims to be."""


def read_weights(path: Path) -> dict[str, Tensor]:
    """The tensors of a .safetensors file, or of a state dictionary that torch saved, by name.

    Raises:
        WeightsError: it is neither.
    """
    try:
        if path.suffix == ".safetensors":
            return safetensors.torch.load_file(path)
        found: object = torch.load(path, map_location="cpu", weights_only=True)
    except UNREADABLE as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise WeightsError(
            f"{path}: cannot be read as weights ({reason}): damaged, or not complete?"
        ) from None
    if not isinstance(found, dict):
        raise WeightsError(f"{path}: holds a {type(found).__name__}, expected weights by name.")
    return {str(name): value for name, value in found.items() if isinstance(value, Tensor)}
