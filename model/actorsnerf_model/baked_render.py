"""The renderer of baked actors: no networks, few samples, all of them near the surface.

    live cells -> tiles of the picture with near and far -> rounds of samples -> composite

Rays start where the tile's first cell begins, take steps that are the same for all pixels, and end
when their light is spent.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from actorsnerf_model.baked import BakedActor, BakedPose, BakedState
from actorsnerf_model.bricks import look_up, read_corners
from actorsnerf_model.posed_grid import PARTS, PosedGrid, places_of
from actorsnerf_model.projection import NEAR_PLANE, project
from actorsnerf_model.rays import Rays, rays_through
from actorsnerf_model.render import render
from actorsnerf_model.states import Camera, Counts, Rendering, RenderOptions

STEP = 0.02
"""Metres between samples along the optical axis."""
ROUND = 4
"""Samples of a ray before its light is measured again."""
STOP = 1 / 256
"""Light below which a ray ends; half a grey level at most."""
TILES_ACROSS = 3
"""Tiles that the shadow of the largest cell may measure; tiles grow until it does."""


@dataclass(frozen=True)
class _Pixels:
    """The pixels that can show anything."""

    place: Int[Tensor, "pixels"]
    """Counted along x, then y."""
    rays: Rays
    first: Int[Tensor, "pixels"]
    """Number of the first sample."""
    last: Int[Tensor, "pixels"]
    """One past the last one's."""


@dataclass
class _Light:
    """What the rays have gathered so far; changed round by round."""

    passing: Float[Tensor, "pixels"]
    rgb: Float[Tensor, "pixels 3"]
    depth: Float[Tensor, "pixels"]


@torch.no_grad()
def render_baked(
    method: BakedActor,
    actor: BakedState,
    pose: BakedPose,
    camera: Camera,
    options: RenderOptions,
) -> Rendering:
    """A whole picture, (height, width).

    A camera amid the body sees through the general renderer.

    Args:
        method: only the general renderer asks it.
        actor: the baked actor.
        pose: of its `pose_state`.
        camera: seen from the posed body frame.
        options: background, threshold and `stop_transmittance` (0: `STOP`) are heeded; samples are
            always `STEP` apart.
    """
    width, height = camera.size
    pixels = _pixels(pose.grid, camera)
    if pixels is None:
        return render(method, actor, pose, camera, options)
    count = pixels.place.shape[0]
    like = pose.bounds
    light = _Light(like.new_ones(count), like.new_zeros(count, 3), like.new_zeros(count))
    due = torch.arange(count, device=like.device)
    stop = options.stop_transmittance or STOP
    samples = survivors = start = 0
    while due.shape[0]:
        asked = _round(actor, pose.grid, (pixels, due, start), light, options.threshold)
        samples += due.shape[0] * ROUND
        survivors += asked
        start += ROUND
        left = (light.passing[due] > stop) & (pixels.first[due] + start < pixels.last[due])
        due = due[left.nonzero()[:, 0]]
    background = like.new_tensor(options.background)
    rgb = background.repeat(height * width, 1)
    rgb[pixels.place] = light.rgb + light.passing[:, None] * background
    alpha = like.new_zeros(height * width).index_copy_(0, pixels.place, 1 - light.passing)
    depth = like.new_zeros(height * width).index_copy_(0, pixels.place, light.depth)
    return Rendering(
        rgb.reshape(height, width, 3),
        alpha.reshape(height, width),
        depth.reshape(height, width),
        Counts(count, samples, survivors),
    )


def _pixels(grid: PosedGrid, camera: Camera) -> _Pixels | None:
    """The pixels of tiles that live cells cast a shadow on; None where a cell is too near to tell.

    A tile's rays begin at its nearest cell's nearest corner and end at its farthest one's farthest.
    """
    width, height = camera.size
    edge = grid.spacing / PARTS
    reach = edge * math.sqrt(3) / 2
    middle = grid.low + (grid.parts + 0.5) * edge
    seen = project(middle, camera.K, camera.camera_from_body)
    near, far = seen.depth - reach, seen.depth + reach
    if bool((near <= NEAR_PLANE).any()):
        return None if bool((far > NEAR_PLANE).any()) else _no_pixels(grid, camera)
    # A sphere's shadow is wider towards the picture's border; the slope bounds by how much.
    focal = camera.K.diagonal()[:2]
    slope = torch.linalg.vector_norm(seen.pixels - camera.K[:2, 2], dim=-1) / focal.amin()
    radius = focal.amax() * reach * (1 + slope) / near
    low, high = seen.pixels - radius[:, None], seen.pixels + radius[:, None]
    size = low.new_tensor(camera.size)
    visible = ((high > -1) & (low < size)).all(1).nonzero()[:, 0]
    if visible.shape[0] == 0:
        return _no_pixels(grid, camera)
    low, high, near, far = low[visible], high[visible], near[visible], far[visible]
    tile = max(1, int((high - low).amax().clamp(max=max(camera.size)) / (TILES_ACROSS - 1)) + 1)
    across, down = -(-width // tile), -(-height // tile)
    first = (low.ceil() / tile).floor().long()
    last = (high.floor() / tile).floor().long()
    steps = torch.arange(TILES_ACROSS + 1, device=low.device)
    column, row = first[:, :1] + steps, first[:, 1:] + steps
    fits = [
        (c >= 0) & (c <= e[:, None]) & (c < n)
        for c, e, n in ((column, last[:, 0], across), (row, last[:, 1], down))
    ]
    which = (fits[1][:, :, None] & fits[0][:, None, :]).reshape(-1).nonzero()[:, 0]
    place = (row[:, :, None] * across + column[:, None, :]).reshape(-1)[which]
    cell = which // steps.shape[0] ** 2
    begin = near.new_full((down * across,), torch.inf).scatter_reduce(0, place, near[cell], "amin")
    end = near.new_zeros(down * across).scatter_reduce(0, place, far[cell], "amax")
    return _of_tiles(begin, end, (tile, across), camera)


def _of_tiles(
    begin: Float[Tensor, "tiles"],
    end: Float[Tensor, "tiles"],
    tiles: tuple[int, int],
    camera: Camera,
) -> _Pixels:
    tile, across = tiles
    width, height = camera.size
    step = torch.arange(tile, device=begin.device)
    lit = (end > 0).nonzero()[:, 0]
    x = ((lit % across) * tile)[:, None, None] + step
    y = (torch.div(lit, across, rounding_mode="floor") * tile)[:, None, None] + step[:, None]
    x, y = x.expand(-1, tile, tile), y.expand(-1, tile, tile)
    inside = ((x < width) & (y < height)).reshape(-1).nonzero()[:, 0]
    x, y = x.reshape(-1)[inside], y.reshape(-1)[inside]
    owner = lit[inside // tile**2]
    rays = rays_through(torch.stack([x, y], -1).to(begin), camera)
    first = (begin[owner] / STEP).floor().long()
    last = (end[owner] / STEP).ceil().long()
    return _Pixels(y * width + x, rays, first, last)


def _no_pixels(grid: PosedGrid, camera: Camera) -> _Pixels:
    none = grid.parts[:0, 0]
    return _Pixels(none, rays_through(grid.rows.new_zeros(0, 2), camera), none, none)


def _round(
    actor: BakedState,
    grid: PosedGrid,
    due: tuple[_Pixels, Int[Tensor, "due"], int],
    light: _Light,
    threshold: float,
) -> int:
    """The next few samples of the rays that are due; how many of them asked the tables."""
    pixels, which, start = due
    directions = pixels.rays.directions[which]
    number = pixels.first[which, None] + (start + torch.arange(ROUND, device=which.device))
    depth = (number.to(directions) + 0.5) * STEP
    origin = (pixels.rays.origin - grid.low) * (PARTS / grid.spacing)
    along = directions * (PARTS / grid.spacing)
    places, part = [], torch.zeros_like(depth)
    within = torch.ones_like(depth, dtype=torch.bool)
    for axis, size in enumerate(grid.live.shape):
        place = torch.addcmul(origin[axis], depth, along[:, axis, None])
        floor = place.floor()
        within &= (floor >= 0) & (floor < size)
        part = part * size + floor
        places.append(place)
    # Whole numbers: exact in float32 below 2^24 parts.
    flat = (part * within).reshape(-1).int()
    asked = (grid.live.reshape(-1).index_select(0, flat) & within.reshape(-1)).nonzero()[:, 0]
    place = torch.stack([place.reshape(-1).index_select(0, asked) for place in places]) / PARTS
    cell = place.floor()
    _, y, z = grid.sizes
    first = ((cell[0] * y + cell[1]) * z + cell[2]).int()
    rows = read_corners(grid.rows, first, place - cell, (1, z, y * z))
    rgb, density = look_up(actor.table, places_of(rows))
    density = density * (rows[:, 4] >= threshold)
    _add(light, which, depth, directions, (asked, rgb, density))
    return asked.shape[0]


def _add(
    light: _Light,
    which: Int[Tensor, "due"],
    depth: Float[Tensor, "due samples"],
    directions: Float[Tensor, "due 3"],
    found: tuple[Int[Tensor, "asked"], Float[Tensor, "asked 3"], Float[Tensor, "asked"]],
) -> None:
    """The light of a round's samples added to what the rays have."""
    place, rgb, density = found
    length = STEP * directions.norm(dim=-1)
    thickness = depth.new_zeros(depth.numel()).index_copy_(0, place, density).reshape(depth.shape)
    through = (thickness * length[:, None]).cumsum(-1)
    passing = torch.cat([torch.ones_like(through[:, :1]), torch.exp(-through)], -1)
    before = light.passing[which]
    weights = (passing[:, :-1] - passing[:, 1:]) * before[:, None]
    light.depth[which] += (weights * depth).sum(-1)
    light.passing[which] = before * passing[:, -1]
    colour = weights.reshape(-1)[place, None] * rgb
    light.rgb.index_add_(0, which[place // depth.shape[1]], colour)


__all__ = ["ROUND", "STEP", "STOP", "render_baked"]
