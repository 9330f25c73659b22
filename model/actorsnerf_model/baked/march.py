"""Light along the rays of a baked actor: no networks, few samples, all of them near the surface.

Rays start where something can be seen, take steps that are the same for all of them, ask only for
density, and end when their light is spent. Colour is looked up at the end, where a sample has a
share of the pixel.
"""

from dataclasses import dataclass, field

import torch
from jaxtyping import Float, Int
from torch import Tensor

from actorsnerf_model.baked.actor import BakedPose
from actorsnerf_model.baked.bricks import BrickTable, Cells, cells_at, colour_at, density_at
from actorsnerf_model.baked.part_shadows import Stretches
from actorsnerf_model.baked.posed_grid import PosedGrid

STEP = 0.02
"""Metres between samples along the optical axis."""
ROUND = 12
"""Samples of a ray before its light is measured; twice as many each time after."""
LEAST_WEIGHT = 1 / 512
"""Share of a pixel below which a sample's colour is not asked for; the others stand in for it."""


@dataclass(frozen=True)
class _Rays:
    """The shadow's rays in parts of the grid and in steps."""

    origin: Float[Tensor, "3"]
    along: Float[Tensor, "3 rays"]
    """What a metre of depth adds."""
    length: Float[Tensor, "rays"]
    """Of a step, metres."""
    first: Float[Tensor, "rays"]
    """Number of the first sample."""
    last: Float[Tensor, "rays"]
    """One past the last one's."""


@dataclass
class _Light:
    """What the rays have gathered so far; changed round by round."""

    passing: Float[Tensor, "rays"]
    depth: Float[Tensor, "rays"]
    ray: list[Tensor] = field(default_factory=list)
    weight: list[Tensor] = field(default_factory=list)
    cells: list[Cells] = field(default_factory=list)
    tested: int = 0
    asked: int = 0

    def counts(self) -> tuple[int, int, int]:
        """Samples tested, asked for their density, and for their colour."""
        return self.tested, self.asked, sum(weight.shape[0] for weight in self.weight)


@dataclass(frozen=True)
class Marched:
    """Rays in the light that they gathered."""

    rgb: Float[Tensor, "3 rays"]
    """Times opacity; nothing of the background."""
    alpha: Float[Tensor, "rays"]
    depth: Float[Tensor, "rays"]
    """Expected depth times alpha, metres."""
    tested: int
    """Samples whose part was looked at."""
    asked: int
    """Samples whose density was looked up."""
    painted: int
    """Samples whose colour was."""


@torch.no_grad()
def march(
    table: BrickTable, posed: BakedPose, rays: Stretches, threshold: float, stop: float
) -> Marched:
    """What the rays show.

    Args:
        table: of the baked field.
        posed: the pose.
        rays: where something can be seen.
        threshold: likelihood below which there is nothing.
        stop: light below which a ray ends.
    """
    steps = _steps(posed.grid, rays)
    light = _Light(torch.ones_like(rays.near), torch.zeros_like(rays.near))
    due = torch.arange(rays.near.shape[0], device=rays.near.device)
    done, count = 0, ROUND
    while due.shape[0]:
        _round(table, posed, (steps, due, range(done, done + count)), light, threshold)
        done, count = done + count, 2 * count
        going = light.passing.index_select(0, due) > stop
        going &= steps.first.index_select(0, due) + done < steps.last.index_select(0, due)
        due = due.index_select(0, going.nonzero()[:, 0])
    alpha = 1 - light.passing
    rgb = _colours(table, light, alpha)
    return Marched(rgb, alpha, light.depth, *light.counts())


def _steps(grid: PosedGrid, rays: Stretches) -> _Rays:
    first, last = (rays.near / STEP).floor(), (rays.far / STEP).ceil()
    x, y, z = rays.directions.unbind(0)
    length = (x * x + y * y + z * z).sqrt() * STEP  # several times faster than a norm
    origin = (rays.origin - grid.low) / grid.edge
    return _Rays(origin, rays.directions / grid.edge, length, first, last)


def _round(
    table: BrickTable,
    posed: BakedPose,
    asked: tuple[_Rays, Int[Tensor, "due"], range],
    light: _Light,
    threshold: float,
) -> None:
    """The next few samples of the rays that are due."""
    rays, due, done = asked
    step = torch.arange(done.start, done.stop, device=due.device)[:, None] + 0.5
    depth = (rays.first.index_select(0, due) + step) * STEP
    live, mapped = _mapped(posed, rays, due, depth)
    light.tested += depth.numel()
    light.asked += live.shape[0]
    cells = cells_at(table, mapped[:3])
    density = density_at(table, cells) * (mapped[3] >= threshold)
    thickness = torch.zeros_like(depth)
    thickness.reshape(-1).scatter_(0, live, density)
    through = (thickness * rays.length.index_select(0, due)).cumsum(0)
    before = light.passing.index_select(0, due)
    passing = torch.exp(-through) * before
    weight = torch.cat([before[None], passing[:-1]]) - passing
    light.passing[due] = passing[-1]
    light.depth[due] += (weight * depth).sum(0)
    weight = weight.reshape(-1).index_select(0, live)
    seen = (weight > LEAST_WEIGHT).nonzero()[:, 0]
    light.ray.append(due.index_select(0, live.index_select(0, seen) % due.shape[0]))
    light.weight.append(weight.index_select(0, seen))
    light.cells.append(Cells(cells.first.index_select(0, seen), cells.share.index_select(1, seen)))


def _mapped(
    posed: BakedPose, rays: _Rays, due: Int[Tensor, "due"], depth: Float[Tensor, "samples due"]
) -> tuple[Int[Tensor, "live"], Float[Tensor, "4 live"]]:
    """The samples in live parts; their canonical places, metres, and likelihoods."""
    grid = posed.grid
    places, flat = [], None
    for axis, size in enumerate(grid.number.shape):
        along = rays.along[axis].index_select(0, due)
        places.append(torch.addcmul(rays.origin[axis], depth, along).reshape(-1))
        # The outermost parts are empty.
        part = places[-1].floor().clamp_(0, size - 1)
        flat = part if flat is None else flat * size + part
    assert flat is not None
    number = grid.number.reshape(-1).index_select(0, flat.int())
    live = (number >= 0).nonzero()[:, 0]
    number = number.index_select(0, live)
    places = [place.index_select(0, live) for place in places]
    mapped = depth.new_empty(4, live.shape[0])
    for channel in range(4):
        total = grid.maps[channel].index_select(0, number)
        for axis, place in enumerate(places, start=1):
            total.addcmul_(grid.maps[4 * axis + channel].index_select(0, number), place)
        mapped[channel] = total
    rough = grid.rough.index_select(0, number).nonzero()[:, 0]
    if rough.shape[0]:
        there = torch.stack([place.index_select(0, rough) for place in places])
        mapped[:, rough] = posed.warp(there * grid.edge + grid.low[:, None])
    return live, mapped


def _colours(
    table: BrickTable, light: _Light, alpha: Float[Tensor, "rays"]
) -> Float[Tensor, "3 rays"]:
    """The mean colour of each ray's samples times its opacity."""
    rgb = alpha.new_zeros(3, alpha.shape[0])
    if not light.ray:
        return rgb
    ray, weight = torch.cat(light.ray), torch.cat(light.weight)
    first = torch.cat([cells.first for cells in light.cells])
    share = torch.cat([cells.share for cells in light.cells], 1)
    colour = colour_at(table, Cells(first, share))
    for channel in range(3):
        rgb[channel].index_add_(0, ray, weight * colour[channel])
    total = torch.zeros_like(alpha).index_add_(0, ray, weight)
    return rgb * (alpha / total.clamp(min=LEAST_WEIGHT))


__all__ = ["LEAST_WEIGHT", "ROUND", "STEP", "Marched", "march"]
