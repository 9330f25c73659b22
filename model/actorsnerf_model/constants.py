"""Numbers that the host knows, on a device that does not wait for them."""

from collections.abc import Sequence

import torch
from jaxtyping import Shaped
from torch import Tensor


def constant(values: Sequence[int | float], like: Tensor) -> Shaped[Tensor, "values"]:
    """The values with another tensor's type, on its device.

    `Tensor.new_tensor` holds the host up until a GPU has done all work that it was given before.
    From pinned memory the copy takes its place among that work instead, and the host goes on.

    Args:
        values: known on the host.
        like: whose type and device are taken.

    >>> constant((1, 0.5), torch.zeros(2)).tolist()
    [1.0, 0.5]
    """
    made = torch.tensor(values, dtype=like.dtype, pin_memory=like.is_cuda)
    return made.to(like.device, non_blocking=True)


__all__ = ["constant"]
