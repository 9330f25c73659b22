"""Batch normalisation whose own statistics are exact on a CPU.

torch adds up the statistics of channels-last batches there in float32, number by number: over three
maps of 256 x 256 the mean was 7e-4 of a deviation off, over 15,526 rows a number up to 2e-4. Those
of planes, one per channel, are added up in float64. So batches are laid out in planes for it.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn


class MapNorm(nn.BatchNorm2d):
    """Of channels-last maps, which the result is too."""

    def forward(
        self, maps: Float[Tensor, "views channels height width"]
    ) -> Float[Tensor, "views channels height width"]:
        """The normalised maps."""
        if not _adds_up(self, maps):
            return super().forward(maps)
        return super().forward(maps.contiguous()).contiguous(memory_format=torch.channels_last)


class RowNorm(nn.BatchNorm1d):
    """Of rows of channels."""

    def forward(self, rows: Float[Tensor, "rows channels"]) -> Float[Tensor, "rows channels"]:
        """The normalised rows."""
        if not _adds_up(self, rows):
            return super().forward(rows)
        return super().forward(rows.T.contiguous()[None])[0].T.contiguous()


def _adds_up(norm: nn.Module, batch: Tensor) -> bool:
    """Whether the batch's own statistics count, and torch would add them up in float32."""
    return norm.training and batch.device.type == "cpu"


__all__ = ["MapNorm", "RowNorm"]
