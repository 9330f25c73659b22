"""Sparse plans of posed bodies, the last few kept: a fitting comes back to the same poses."""

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.sparse_plan import SparsePlan, plan_sparse

KEPT = 16
"""Plans; at the released sizes one takes about 20 MB."""


class PosePlans:
    """The plans of one actor's poses; equal vertices give the same plan, kept or made."""

    def __init__(self, voxel: float, levels: int, kept: int = KEPT) -> None:
        """None yet.

        Args:
            voxel: edge of a voxel of level 0, metres.
            levels: how many resolutions.
            kept: how many plans are not made again.
        """
        self.voxel = voxel
        self.levels = levels
        self.kept = kept
        self.plans: dict[bytes, SparsePlan] = {}
        """By the vertices' bytes; the one asked for last stands last."""

    def plan(self, vertices: Float[Tensor, "vertices 3"]) -> SparsePlan:
        """The plan of posed vertices, metres.

        The grid leaves so much room around them that no level is cut off: features fall to zero
        inside it.
        """
        key = vertices.detach().cpu().numpy().tobytes()
        plan = self.plans.pop(key, None)
        if plan is None:
            plan = self._made(vertices.detach())
            while len(self.plans) >= self.kept:
                del self.plans[next(iter(self.plans))]
        self.plans[key] = plan
        return plan

    def _made(self, vertices: Float[Tensor, "vertices 3"]) -> SparsePlan:
        # Halving reaches under one coarsest voxel further, and interpolation one more.
        room = 2**self.levels * self.voxel
        box = torch.stack([vertices.amin(0) - room, vertices.amax(0) + room])
        return plan_sparse(vertices, box, self.voxel, self.levels)


__all__ = ["PosePlans"]
