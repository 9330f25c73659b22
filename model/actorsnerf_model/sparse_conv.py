"""Sparse 3D convolution in plain torch: it spreads vertex features into the space around them.

Per kernel offset one matrix product over the pairs that meet, then one sum per target; forward and
backward both gather, so a CPU gives the same bits every time.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn import functional as F

from actorsnerf_model.batch_norm import RowNorm
from actorsnerf_model.interpolation import corners
from actorsnerf_model.sparse_plan import OFFSETS, Level, Merge, Pairs, SparsePlan


@dataclass(frozen=True)
class SparseConfig:
    """Sizes of the sparse network; defaults are the released code's: 13 convolutions."""

    voxel: float = 0.005
    """Metres."""
    channels: tuple[int, ...] = (64, 64, 64, 128)
    """Of each level."""
    convolutions: tuple[int, ...] = (2, 2, 3, 3)
    """Submanifold convolutions on each level, after the one of stride 2 that leads there."""
    taps: tuple[int, ...] = (1, 2, 3)
    """Levels that points read."""

    @property
    def tapped_channels(self) -> int:
        """How many features a point reads."""
        return sum(self.channels[tap] for tap in self.taps)


@dataclass(frozen=True)
class FeatureLevel:
    """Features on the active voxels of one level; zero elsewhere."""

    features: Float[Tensor, "rows channels"]
    index: Int[Tensor, "z y x"]
    """The voxel's row, -1 where nothing is."""
    origin: Float[Tensor, "3"]
    """x, y, z of the centre of voxel 0, metres."""
    cell: float
    """Edge of a voxel, metres."""


def query(
    levels: Sequence[FeatureLevel], points: Float[Tensor, "points 3"]
) -> Float[Tensor, "points channels"]:
    """Features at the points, trilinear, level after level; zero outside.

    Coordinates are exact: (x - origin) / cell. The released code divides by the grid's size and
    multiplies by the size minus one, which pulls points up to one cell towards the origin.

    Args:
        levels: the tapped levels.
        points: metres, frame of the levels.
    """
    return torch.cat([_query_level(level, points) for level in levels], dim=1)


def _query_level(
    level: FeatureLevel, points: Float[Tensor, "points 3"]
) -> Float[Tensor, "points channels"]:
    nodes, weights = corners((points - level.origin) / level.cell, tuple(level.index.shape))
    rows = level.index.flatten()[nodes]
    return F.embedding_bag(
        rows.clamp(min=0),
        level.features,
        mode="sum",
        per_sample_weights=(weights * (rows >= 0)).to(level.features.dtype),
    )


class _Convolve(torch.autograd.Function):
    """Features (rows, in) and weight (27, in, out) to features of the targets (targets, out)."""

    @staticmethod
    def forward(ctx: Any, features: Tensor, weight: Tensor, pairs: Pairs) -> Tensor:
        ctx.save_for_backward(features, weight)
        ctx.pairs = pairs
        products = _products(features.index_select(0, pairs.source), weight, pairs.counts)
        return _sums(products, pairs.target_order, pairs.target_starts)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        features, weight = ctx.saved_tensors
        pairs: Pairs = ctx.pairs
        given = gradient.index_select(0, pairs.target)
        feature_gradient = None
        if ctx.needs_input_grad[0]:
            products = _products(given, weight.transpose(1, 2), pairs.counts)
            feature_gradient = _sums(products, pairs.source_order, pairs.source_starts)
        weight_gradient = torch.empty_like(weight)
        source = features.index_select(0, pairs.source)
        ends = _ends(pairs.counts)
        for offset, (start, end) in enumerate(pairwise(ends)):
            torch.mm(source[start:end].T, given[start:end], out=weight_gradient[offset])
        return feature_gradient, weight_gradient, None


class _Merge(torch.autograd.Function):
    """Vertex features (vertices, channels) to their mean in each voxel (rows, channels)."""

    @staticmethod
    def forward(ctx: Any, features: Tensor, merge: Merge) -> Tensor:
        ctx.merge = merge
        sums = _sums(features, merge.order, merge.starts)
        return sums * merge.shares.to(sums.dtype)[:, None]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        merge: Merge = ctx.merge
        return (gradient * merge.shares.to(gradient.dtype)[:, None])[merge.row], None


# Autograd functions are untyped; these names give them their types.
_merge: Callable[[Tensor, Merge], Tensor] = _Merge.apply
convolve: Callable[[Tensor, Tensor, Pairs], Tensor] = _Convolve.apply


def _ends(counts: tuple[int, ...]) -> list[int]:
    ends = [0]
    for count in counts:
        ends.append(ends[-1] + count)
    return ends


def _products(
    rows: Float[Tensor, "pairs in"], weight: Float[Tensor, "27 in out"], counts: tuple[int, ...]
) -> Float[Tensor, "pairs out"]:
    products = rows.new_empty(len(rows), weight.shape[2])
    for offset, (start, end) in enumerate(pairwise(_ends(counts))):
        torch.mm(rows[start:end], weight[offset], out=products[start:end])
    return products


def _sums(
    rows: Float[Tensor, "items channels"],
    order: Int[Tensor, "items"],
    starts: Int[Tensor, "groups"],
) -> Float[Tensor, "groups channels"]:
    return F.embedding_bag(order, rows, starts, mode="sum")


def merge_vertices(
    features: Float[Tensor, "vertices channels"], merge: Merge
) -> Float[Tensor, "rows channels"]:
    """The mean of the features in each voxel; the released code takes whichever comes last."""
    return _merge(features, merge)


class SparseConvolution(nn.Module):
    """A 3x3x3 convolution over pairs, without bias, then BatchNorm over voxels, then ReLU."""

    def __init__(self, inputs: int, outputs: int) -> None:
        """Weights uniform within 1 / sqrt(27 * inputs)."""
        super().__init__()
        bound = 1 / math.sqrt(OFFSETS * inputs)
        self.weight = nn.Parameter(torch.empty(OFFSETS, inputs, outputs).uniform_(-bound, bound))
        self.norm = RowNorm(outputs, eps=1e-3, momentum=0.01)

    def forward(
        self, features: Float[Tensor, "sources in"], pairs: Pairs
    ) -> Float[Tensor, "targets out"]:
        """Features of the targets, in the parameters' precision; products in the given one."""
        convolved = convolve(features, self.weight.to(features.dtype), pairs)
        normed: Tensor = self.norm(convolved.to(self.weight.dtype))
        return F.relu(normed)


class SparseNet(nn.Module):
    """Vertex features in, features on the voxels of the tapped levels out (paper sec. 3.5)."""

    def __init__(self, config: SparseConfig, inputs: int) -> None:
        """Random weights for `inputs` numbers per vertex."""
        super().__init__()
        self.config = config
        stages = []
        for level, (channels, count) in enumerate(
            zip(config.channels, config.convolutions, strict=True)
        ):
            total = count + (level > 0)
            sizes = [inputs] + [channels] * total
            stages.append(nn.ModuleList(SparseConvolution(a, b) for a, b in pairwise(sizes)))
            inputs = channels
        self.stages = nn.ModuleList(stages)

    def forward(
        self, features: Float[Tensor, "vertices inputs"], plan: SparsePlan, dtype: torch.dtype
    ) -> tuple[FeatureLevel, ...]:
        """The tapped levels; matrix products in `dtype`, batch norms in the parameters'."""
        rows = merge_vertices(features, plan.merge)
        tapped = {}
        with torch.autocast(rows.device.type, enabled=False):
            for i, stage in enumerate(self.stages):
                assert isinstance(stage, nn.ModuleList)
                for j, layer in enumerate(stage):
                    pairs = plan.down[i - 1] if i and j == 0 else plan.levels[i].same
                    rows = layer(rows.to(dtype), pairs)
                tapped[i] = rows
        return tuple(
            FeatureLevel(tapped[i], _index(plan.levels[i]), plan.origin, plan.voxel * 2**i)
            for i in self.config.taps
        )


def _index(level: Level) -> Int[Tensor, "z y x"]:
    index = torch.full(level.shape, -1, dtype=torch.int32, device=level.voxels.device)
    z, y, x = level.voxels.unbind(1)
    index[z, y, x] = torch.arange(len(z), dtype=torch.int32, device=index.device)
    return index
