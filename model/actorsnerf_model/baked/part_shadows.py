"""Which pixels the live parts of a posed grid can show, and between which depths."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from actorsnerf_model.baked.posed_grid import PosedGrid
from actorsnerf_model.occupancy import window_max
from actorsnerf_model.projection import NEAR_PLANE
from actorsnerf_model.rays import rays_through
from actorsnerf_model.states import Camera

SPREAD = 2
"""Tiles from a part's middle to the end of its shadow, at most; tiles grow until it fits."""
BORDER = SPREAD + 1
"""Tiles around the picture where parts lie whose shadow falls into it."""


@dataclass(frozen=True)
class Shadow:
    """Where something can be seen, in square tiles of the picture."""

    near: Float[Tensor, "down across"]
    """Metres along the optical axis; nothing is nearer. Infinite where nothing is."""
    far: Float[Tensor, "down across"]
    """Nothing is farther; 0 where nothing is."""
    tile: int
    """Pixels along the side of a tile."""
    window: tuple[int, int, int, int]
    """Pixels that any lit tile covers: first and one past the last column, then row."""
    nearest: float
    """Of all parts that the camera sees, metres."""


@dataclass(frozen=True)
class Stretches:
    """Rays where something can be seen, and where on them."""

    origin: Float[Tensor, "3"]
    """Body frame, metres."""
    directions: Float[Tensor, "3 rays"]
    """Body frame; their component along the optical axis is 1."""
    near: Float[Tensor, "rays"]
    """Metres along the optical axis."""
    far: Float[Tensor, "rays"]


@torch.no_grad()
def part_shadows(grid: PosedGrid, camera: Camera) -> Shadow | None:
    """The shadow of a grid's live parts; None where one is too near the camera to tell.

    Every part counts as the ball around it, which spreads over the square of tiles around its
    middle; a tile begins with the nearest of its balls and ends with the farthest.

    Args:
        grid: of a pose.
        camera: seen from the posed body frame.
    """
    reach = grid.edge * math.sqrt(3) / 2
    turned = camera.camera_from_body[:3]
    start = turned[:, :3] @ (grid.low + grid.edge / 2) + turned[:, 3]
    steps = turned[:, :3] * grid.edge
    x, y, depth = torch.addmm(start[:, None], steps, grid.parts.to(start)).unbind(0)
    near, far = depth - reach, depth + reach
    if bool((near <= NEAR_PLANE).any()):
        return None if bool((far > NEAR_PLANE).any()) else _nothing(near)
    # A ball's shadow is wider towards the picture's border; the slope bounds by how much.
    focal = camera.K.diagonal()[:2]
    x, y = x / depth, y / depth
    slope = torch.hypot(x, y) * (focal.amax() / focal.amin())
    radius = focal.amax() * reach * (1 + slope) / near
    x, y = torch.addmm(camera.K[:2, 2:], camera.K[:2, :2], torch.stack([x, y])).unbind(0)
    width, height = camera.size
    visible = (x + radius > -1) & (x - radius < width) & (y + radius > -1) & (y - radius < height)
    which = visible.nonzero()[:, 0]
    if which.shape[0] == 0:
        return _nothing(near)
    tile = max(1, math.ceil(float(radius[which].amax()) / SPREAD))
    across, down = (-(-side // tile) + 2 * BORDER for side in (width, height))
    column, row = ((along[which] / tile).floor() + BORDER for along in (x, y))
    place, near, far = (row * across + column).long(), near[which], far[which]
    begin = near.new_full((across * down,), torch.inf).scatter_reduce(0, place, near, "amin")
    end = near.new_zeros(across * down).scatter_reduce(0, place, far, "amax")
    begin, end = -_widest(-begin.reshape(down, across)), _widest(end.reshape(down, across))
    window = _window(end > 0, tile, camera.size)
    return Shadow(begin, end, tile, window, float(near.amin()))


def stretches(
    shadow: Shadow, x: Int[Tensor, "rays"], y: Int[Tensor, "rays"], camera: Camera
) -> Stretches:
    """The rays of pixels, as far as anything can be seen on them.

    Args:
        shadow: in this camera.
        x: columns.
        y: rows.
        camera: seen from the posed body frame.
    """
    tile = shadow.tile
    owner = torch.div(y, tile, rounding_mode="floor") * shadow.near.shape[1]
    owner = owner + torch.div(x, tile, rounding_mode="floor")
    some = rays_through(camera.K.new_tensor([[0, 0], [1, 0], [0, 1]]), camera)
    corner, right, below = some.directions
    directions = torch.addcmul(corner[:, None], (right - corner)[:, None], x.to(corner))
    directions.addcmul_((below - corner)[:, None], y.to(corner))
    near, far = (depth.reshape(-1).index_select(0, owner) for depth in (shadow.near, shadow.far))
    return Stretches(some.origin, directions, near, far)


def _widest(values: Float[Tensor, "down across"]) -> Float[Tensor, "d a"]:
    """Largest values within `SPREAD` tiles, without the border."""
    for axis in range(2):
        values = window_max(values, axis, 2 * SPREAD + 1)
    return values[1:-1, 1:-1]


def _window(lit: Tensor, tile: int, size: tuple[int, int]) -> tuple[int, int, int, int]:
    ends = []
    for axis, side in ((0, size[0]), (1, size[1])):
        along = lit.any(axis).nonzero()[:, 0]
        first, last = (int(along[0]), int(along[-1]) + 1) if along.shape[0] else (0, 0)
        ends += [first * tile, min(last * tile, side)]
    return ends[0], ends[1], ends[2], ends[3]


def _nothing(like: Float[Tensor, "parts"]) -> Shadow:
    empty = like.new_zeros(0, 0)
    return Shadow(empty, empty, 1, (0, 0, 0, 0), math.inf)


__all__ = ["Shadow", "Stretches", "part_shadows", "stretches"]
