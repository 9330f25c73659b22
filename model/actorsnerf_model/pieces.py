"""How many points are computed together: on a CPU what its cache holds, elsewhere much more."""

import torch

TIMES_OFF_CPU = 16
"""An accelerator has no such cache, and every piece costs it some starts of work."""


def at_once(on_cpu: int, device: torch.device) -> int:
    """How many points a piece has.

    >>> at_once(8192, torch.device("cpu")), at_once(8192, torch.device("cuda"))
    (8192, 131072)
    """
    return on_cpu if device.type == "cpu" else TIMES_OFF_CPU * on_cpu


__all__ = ["at_once"]
