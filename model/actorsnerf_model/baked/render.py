"""The renderer of baked actors: the live parts' shadow, every second pixel, then those in need.

Where pixels are finer than the voxels, a pixel between drawn ones that show the same surface takes
their mean, and one between empty ones is empty; outlines are drawn pixel by pixel.
"""

import functools
from collections.abc import Callable

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_model.baked.actor import BakedActor, BakedPose, BakedState
from actorsnerf_model.baked.march import STEP, Marched, march
from actorsnerf_model.baked.part_shadows import Shadow, part_shadows, stretches
from actorsnerf_model.render import render
from actorsnerf_model.states import Camera, Counts, Rendering, RenderOptions

STOP = 1 / 256
"""Light below which a ray ends; half a grey level at most."""
FINE = 0.5
"""Voxels that the nearest pixel may measure for every second one to be left to its neighbours: the
drawn ones then are no farther apart than what the grid can tell. (At 0.7, LPIPS x1000 was 2 worse.)
"""
SURFACE = 0.03
"""Metres of depth between pixels that can show the same surface."""
OPAQUE = 0.9
"""Opacity from which a pixel shows a surface."""
EMPTY = 1 / 512
"""Opacity up to which a pixel shows nothing."""
Draw = Callable[[Tensor, Tensor], Tensor]
"""Columns and rows of pixels to (channels, pixels)."""
CHANNELS = 5
"""Of a picture that is being drawn: colour times opacity, opacity, depth times opacity."""


@torch.no_grad()
def render_baked(
    method: BakedActor,
    actor: BakedState,
    pose: BakedPose,
    camera: Camera,
    options: RenderOptions,
) -> Rendering:
    """A whole picture, (height, width); in full precision whatever lies around it.

    A camera amid the body sees through the general renderer.

    Args:
        method: only the general renderer asks it.
        actor: the baked actor.
        pose: of its `pose_state`.
        camera: seen from the posed body frame.
        options: background, `stop_transmittance` (0: `STOP`) and a threshold above the one that it
            was baked for are heeded; samples are always `STEP` apart.
    """
    with torch.autocast(pose.bounds.device.type, enabled=False):
        shadow = part_shadows(pose.grid, camera)
        if shadow is None:
            return render(method, actor, pose, camera, options)
        return _within(shadow, actor, pose, camera, options)


def _within(
    shadow: Shadow, actor: BakedState, pose: BakedPose, camera: Camera, options: RenderOptions
) -> Rendering:
    """The picture of the parts in a shadow."""
    left, right, top, bottom = shadow.window
    stop = options.stop_transmittance or STOP
    drawn: list[Marched] = []

    def draw(x: Tensor, y: Tensor) -> Tensor:
        rays = stretches(shadow, x + left, y + top, camera)
        drawn.append(march(actor.table, pose, rays, options.threshold, stop))
        return torch.cat([drawn[-1].rgb, drawn[-1].alpha[None], drawn[-1].depth[None]])

    lit = _lit(shadow)
    fine = shadow.nearest <= FINE * actor.data.field.voxel * float(camera.K.diagonal()[:2].amin())
    seen = _by_halves(draw, lit) if fine else _all(draw, lit)
    width, height = camera.size
    background = pose.bounds.new_tensor(options.background)
    rgb = background.repeat(height, width, 1)
    alpha, depth = rgb.new_zeros(2, height, width).unbind(0)
    rgb[top:bottom, left:right] = seen[:3].permute(1, 2, 0) + (1 - seen[3])[..., None] * background
    alpha[top:bottom, left:right] = seen[3]
    depth[top:bottom, left:right] = seen[4]
    counts = [Counts(one.alpha.shape[0], one.tested, one.asked, one.painted) for one in drawn]
    return Rendering(rgb, alpha, depth, Counts.total(counts))


def _lit(shadow: Shadow) -> Bool[Tensor, "height width"]:
    """The window's pixels that can show anything."""
    left, right, top, bottom = shadow.window
    tile = shadow.tile
    tiles = (shadow.far > 0)[top // tile : -(-bottom // tile), left // tile : -(-right // tile)]
    pixels = tiles.repeat_interleave(tile, 0).repeat_interleave(tile, 1)
    return pixels[: bottom - top, : right - left]


def _all(draw: Draw, lit: Bool[Tensor, "height width"]) -> Float[Tensor, "5 height width"]:
    """Every lit pixel drawn."""
    y, x = lit.nonzero().unbind(-1)
    values = draw(x, y)
    picture = values.new_zeros(CHANNELS, *lit.shape)
    picture[:, y, x] = values
    return picture


def _by_halves(draw: Draw, lit: Bool[Tensor, "height width"]) -> Float[Tensor, "5 height width"]:
    """Every second lit pixel of every second row drawn, and of the others those in need."""
    drawn = _all(lambda x, y: draw(2 * x, 2 * y), lit[::2, ::2])
    coarse = F.pad(drawn, (0, 1, 0, 1), value=torch.nan)  # pixels that agree with nothing
    surface = torch.where(coarse[3] >= OPAQUE, coarse[4] / coarse[3], torch.nan)
    picture = drawn.new_zeros(CHANNELS, *lit.shape)
    picture[:, ::2, ::2] = drawn
    need = lit.clone()
    need[::2, ::2] = False
    for below, right in ((0, 1), (1, 0), (1, 1)):
        rows, columns = lit[below::2, right::2].shape
        corners = [(y, x) for y in range(below + 1) for x in range(right + 1)]
        around = [coarse[:, y : y + rows, x : x + columns] for y, x in corners]
        depths = [surface[y : y + rows, x : x + columns] for y, x in corners]
        alike = _most(depths) + _most([-depth for depth in depths]) <= SURFACE
        alike |= _most([one[3] for one in around]) <= EMPTY
        mean = sum(around[1:], around[0]) / len(around)
        picture[:, below::2, right::2] = torch.where(alike & lit[below::2, right::2], mean, 0.0)
        need[below::2, right::2] &= ~alike
    y, x = need.nonzero().unbind(-1)
    picture[:, y, x] = draw(x, y)
    return picture


def _most(values: list[Tensor]) -> Tensor:
    """The largest, place by place; nothing where one of them is none."""
    return functools.reduce(torch.maximum, values)


__all__ = ["STEP", "STOP", "render_baked"]
