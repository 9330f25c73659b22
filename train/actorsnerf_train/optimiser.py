"""Adam with a rate for each part of the network, decayed step by step."""

import torch
from torch import nn

from actorsnerf_train.config import Rates
from actorsnerf_train.schedule import Schedule, rate_factor

BASE_RATE = "base_rate"
"""Where a parameter group keeps its rate before decay."""


def adam(parts: dict[str, nn.Module], rates: Rates) -> torch.optim.Adam:
    """Adam over all parameters that take gradients, one group a part.

    Released code: betas (0.9, 0.999), no weight decay, no gradient clipping.
    """
    groups = []
    for name, part in parts.items():
        parameters = [p for p in part.parameters() if p.requires_grad]
        if parameters:
            rate = rates.of(name)
            groups.append({"params": parameters, "lr": rate, BASE_RATE: rate})
    return torch.optim.Adam(groups, betas=(0.9, 0.999))


def set_rates(optimiser: torch.optim.Optimizer, schedule: Schedule, step: int) -> float:
    """The decay factor of a step, after every group's rate was set by it."""
    factor = rate_factor(schedule, step)
    for group in optimiser.param_groups:
        group["lr"] = group[BASE_RATE] * factor
    return factor
