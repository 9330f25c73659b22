"""The renderer: cull, locate, field, composite; empty space never reaches a network.

    rays -> bounds -> samples -> occupied cells -> likelihood -> survivors -> field -> composite

Every step before the field only drops samples that the field would be asked for in vain, so the
picture is the reference renderer's. Culling needs no gradient; the survivors keep theirs.
"""

import math
from dataclasses import dataclass, replace
from typing import Generic

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from actorsnerf_model.constants import constant
from actorsnerf_model.cores import on_all_cores, side_by_side
from actorsnerf_model.footprint import footprint
from actorsnerf_model.pieces import at_once
from actorsnerf_model.pixels_by_need import Agreement, by_need
from actorsnerf_model.rays import (
    Rays,
    draw_jitter,
    intersect_box,
    rays_through,
    sample_depths,
    spacings,
    unit,
)
from actorsnerf_model.states import (
    ActorState,
    Camera,
    Counts,
    Located,
    Method,
    Occupancy,
    PoseState,
    Rendering,
    RenderOptions,
)
from actorsnerf_model.volume_rendering import (
    Composited,
    composite,
    optical_depth,
    shares_so_far,
)

RAYS_AT_ONCE = 8192
"""Rays whose samples are laid out together; bounds the memory of a picture."""
RAYS_A_CORE = 512
"""Rays that a core of its own is worth."""
POINTS_AT_ONCE = 65536
"""Points that are located together, on a CPU."""
LOOKED_AT_ONCE = 8192
"""Points through the field at once where no gradient is wanted, on a CPU: what is read for them
stays in its cache. A gradient wants few large pieces, because each makes one of whole tables."""
STRIDE = 4
"""Survivors of a ray that go through the networks before its light is measured again."""

INSIDE = 0.5
"""Opacity from which a pixel shows the person: only between such pixels is one interpolated."""


@dataclass(frozen=True)
class _Scene(Generic[ActorState]):
    method: Method[ActorState]
    actor: ActorState
    pose: PoseState
    options: RenderOptions


@dataclass(frozen=True)
class _Samples:
    """Samples on rays that meet the bounds."""

    rays: Rays
    depths: Float[Tensor, "rays samples"]
    spacing: Float[Tensor, "rays samples"]


@dataclass(frozen=True)
class _Survivors:
    """Samples that went through the field; `place` counts through rays, then samples."""

    place: Int[Tensor, "survivors"]
    rgb: Float[Tensor, "survivors 3"]
    thickness: Float[Tensor, "survivors"]
    painted: int
    """How many colours were computed."""


def render(
    method: Method[ActorState],
    actor: ActorState,
    pose: PoseState,
    camera: Camera,
    options: RenderOptions,
) -> Rendering:
    """A whole picture, (height, width); its cost grows with the person, not with the picture.

    Only pixels in the shadow of the occupied cells (or of the bounds) become rays; the others are
    background, and `counts.rays` leaves them out, like those that are interpolated.

    Args:
        method: the model.
        actor: its `actor_state`.
        pose: its `pose_state`.
        camera: seen from the posed body frame.
        options: how to spend work.
    """
    width, height = camera.size
    options = _honest(options, pose)
    where = footprint(pose, camera, options.occupancy)
    counts: list[Counts] = []

    def seen(number: Tensor) -> Rendering:
        pixels = torch.stack([number % width, number // width], -1).to(camera.K.dtype)
        return render_pixels(method, actor, pose, rays_through(pixels, camera), options)

    def draw(number: Tensor) -> Tensor:
        # Neighbours cost about the same: in turns, every core gets as much work.
        cores = max(1, min(side_by_side(number.device), number.shape[0] // RAYS_A_CORE))
        drawn = on_all_cores(seen, [number[core::cores] for core in range(cores)], number.device)
        counts.extend(part.counts for part in drawn)
        values = camera.K.new_empty(number.shape[0], 5)
        for core, part in enumerate(drawn):
            channels = [part.rgb, part.alpha[:, None], part.depth[:, None]]
            values[core::cores] = torch.cat(channels, -1)
        return values

    empty = camera.K.new_tensor([*options.background, 0.0, 0.0]).repeat(height, width, 1)
    stride = options.pixel_stride if options.pixel_tolerance > 0 else 1
    alike = Agreement(
        empty.new_tensor([*[options.pixel_tolerance] * 4, math.inf]),
        empty.new_tensor([*[-math.inf] * 3, INSIDE, -math.inf]),
    )
    picture = by_need(draw, where, empty, stride, alike)
    return Rendering(picture[..., :3], picture[..., 3], picture[..., 4], Counts.total(counts))


def render_pixels(
    method: Method[ActorState],
    actor: ActorState,
    pose: PoseState,
    rays: Rays,
    options: RenderOptions,
    generator: torch.Generator | None = None,
) -> Rendering:
    """The colours of rays, (rays,); differentiable in what the states and the method hold.

    Args:
        method: the model.
        actor: its `actor_state`.
        pose: its `pose_state`.
        rays: in the posed body frame, of `rays_through`.
        options: how to spend work.
        generator: jitters the samples (training); None spaces them evenly.
    """
    options = _honest(options, pose)
    jitter = draw_jitter(rays, options.samples, generator)
    span = intersect_box(rays, pose.bounds)
    hit = span.hit.nonzero()[:, 0]
    background = constant(options.background, rays.directions)
    rgb = background.repeat(rays.directions.shape[0], 1)
    alpha = torch.zeros_like(rgb[:, 0])
    depth = torch.zeros_like(alpha)
    scene = _Scene(method, actor, pose, options)
    survivors = painted = 0
    for part in torch.split(hit, RAYS_AT_ONCE):
        some = Rays(rays.origin, rays.directions[part])
        strata = None if jitter is None else jitter[part]
        depths = sample_depths(span.near[part], span.far[part], options.samples, strata)
        spacing = spacings(depths, span.near[part], span.far[part], some)
        samples = _Samples(some, depths, spacing)
        found = _survivors(scene, samples)
        survivors += found.place.shape[0]
        painted += found.painted
        row, seen = _composited(samples, found, background)
        rgb = rgb.index_copy(0, part[row], seen.rgb)
        alpha = alpha.index_copy(0, part[row], seen.alpha)
        depth = depth.index_copy(0, part[row], seen.depth)
    counts = Counts(hit.shape[0], hit.shape[0] * options.samples, survivors, painted)
    return Rendering(rgb, alpha, depth, counts)


def _honest(options: RenderOptions, pose: PoseState) -> RenderOptions:
    """The options without cells that were made for a higher threshold than is asked for."""
    made_for = pose.occupancy.threshold if pose.occupancy is not None else 0.0
    return options if made_for <= options.threshold else replace(options, occupancy=False)


def _survivors(scene: _Scene[ActorState], samples: _Samples) -> _Survivors:
    """The samples that can be seen, through the field."""
    occupancy = scene.pose.occupancy if scene.options.occupancy else None
    candidates = _candidates(samples, occupancy)
    if scene.options.least_learned > 0 and torch.is_grad_enabled():
        return _learned(scene, samples, candidates)
    located = _located(scene, samples, candidates)
    if scene.options.stop_transmittance > 0:
        return _until_opaque(scene, samples, located)
    return _through_field(scene, samples, located)


def _learned(
    scene: _Scene[ActorState], samples: _Samples, candidates: Int[Tensor, "candidates"]
) -> _Survivors:
    """The samples that add enough to their pixels to learn from, with what gradients need.

    A first look at densities, front to back and without gradients, tells which those are. What is
    no number counts as seen, so that it reaches the loss, where it is noticed.
    """
    least = scene.options.least_learned
    look = replace(scene.options, least_weight=1.0, stop_transmittance=least)
    with torch.no_grad():
        found = _until_opaque(
            replace(scene, options=look), samples, _located(scene, samples, candidates)
        )
        place, order = found.place.sort()
        share = shares_so_far(found.thickness[order], place // samples.depths.shape[1])
    return _through_field(scene, samples, _located(scene, samples, place[~(share <= least)]))


def _located(
    scene: _Scene[ActorState], samples: _Samples, candidates: Int[Tensor, "candidates"]
) -> Located:
    """The candidates that pass the foreground test; their index counts as `_candidates`' does."""
    count = samples.depths.shape[1]
    pieces = []
    for part in torch.split(candidates, at_once(POINTS_AT_ONCE, candidates.device)):
        depth = samples.depths.reshape(-1)[part]
        points = samples.rays.origin + depth[:, None] * samples.rays.directions[part // count]
        located = scene.method.locate(scene.actor, scene.pose, points, scene.options.threshold)
        pieces.append(replace(located, index=part[located.index]))
    index = torch.cat([piece.index for piece in pieces])
    return Located(
        index,
        torch.cat([piece.canonical for piece in pieces]),
        torch.cat([piece.likelihood for piece in pieces]),
        unit(samples.rays.directions)[index // count] if scene.method.reads_directions else None,
    )


@torch.no_grad()
def _candidates(samples: _Samples, occupancy: Occupancy | None) -> Int[Tensor, "candidates"]:
    """Ascending numbers, through rays, then samples, of those in occupied cells, or of all."""
    depths = samples.depths
    if occupancy is None:
        return torch.arange(depths.numel(), device=depths.device)
    cell = torch.zeros_like(depths, dtype=torch.long)
    for axis, size in enumerate(occupancy.cells.shape):
        scale = size / (occupancy.box[1, axis] - occupancy.box[0, axis])
        start = (samples.rays.origin[axis] - occupancy.box[0, axis]) * scale
        along = torch.addcmul(start, depths, samples.rays.directions[:, axis, None] * scale)
        # Samples lie in the box up to rounding, which must not lose those on its faces.
        cell = cell * size + along.floor_().clamp_(0, size - 1).long()
    return occupancy.cells.reshape(-1)[cell].reshape(-1).nonzero()[:, 0]


def _through_field(scene: _Scene[ActorState], samples: _Samples, located: Located) -> _Survivors:
    options = scene.options
    likelihood = located.likelihood if options.soft_mask else None
    ray = located.index // samples.depths.shape[1]
    spacing = samples.spacing.reshape(-1)[located.index]
    rgb, thickness, count = [], [], 0
    chunk = options.chunk
    if not torch.is_grad_enabled():
        chunk = min(chunk, at_once(LOOKED_AT_ONCE, ray.device))
    for first in range(0, located.index.shape[0], chunk):
        part = slice(first, first + chunk)
        some = _chosen(located, part)
        masked = None if likelihood is None else likelihood[part]
        painted = _painted(scene, some, (ray[part], spacing[part], masked), first >= options.kept)
        rgb.append(painted.rgb)
        thickness.append(painted.thickness)
        count += painted.painted
    if not rgb:
        return _Survivors(located.index, located.canonical, located.likelihood, 0)
    return _Survivors(located.index, torch.cat(rgb), torch.cat(thickness), count)


def _painted(
    scene: _Scene[ActorState],
    located: Located,
    along: tuple[Int[Tensor, "points"], Float[Tensor, "points"], Float[Tensor, "points"] | None],
    again: bool,
) -> _Survivors:
    """Colours (black where they cannot be seen) and optical depths of one chunk.

    Args:
        scene: what is drawn.
        located: points in order along their rays.
        along: their rays, the lengths they stand for, and the likelihoods of a soft mask.
        again: compute it a second time for its gradient, instead of keeping what that needs.
    """
    ray, spacing, _ = along

    def paint(
        canonical: Tensor, likelihood: Tensor, masked: Tensor | None
    ) -> tuple[Tensor, Tensor, int]:
        moved = replace(located, canonical=canonical, likelihood=likelihood)
        field = scene.method.field(scene.actor, scene.pose, moved)
        thickness = optical_depth(field.density.to(spacing.dtype), spacing, masked)
        if scene.options.least_weight >= 1:  # no share is greater
            return thickness.new_zeros(ray.shape[0], 3), thickness, 0
        share = shares_so_far(thickness.detach(), ray)
        seen = (share > scene.options.least_weight).nonzero()[:, 0]
        if seen.shape[0] == ray.shape[0]:
            return field.rgb.to(spacing.dtype), thickness, seen.shape[0]
        colours = field.colours(seen).to(spacing.dtype)
        black = colours.new_zeros(ray.shape[0], 3)
        return black.index_copy(0, seen, colours), thickness, seen.shape[0]

    given = (located.canonical, located.likelihood, along[2])
    if not (again and torch.is_grad_enabled()):
        return _Survivors(located.index, *paint(*given))
    kept = checkpoint(
        paint,
        *given,
        use_reentrant=False,
        preserve_rng_state=False,  # no field draws random numbers
    )
    return _Survivors(located.index, *kept)


def _until_opaque(scene: _Scene[ActorState], samples: _Samples, located: Located) -> _Survivors:
    """The same front to back, a few survivors of every ray at a time, until its light is spent.

    What is left out has at most `stop_transmittance` of the light, and so of the colour.
    """
    rays, count = samples.depths.shape
    ray = located.index // count
    per_ray = ray.new_zeros(rays).index_add_(0, ray, torch.ones_like(ray))
    rank = torch.arange(ray.shape[0], device=ray.device) - (per_ray.cumsum(0) - per_ray)[ray]
    enough = -math.log(scene.options.stop_transmittance)
    absorbed = samples.depths.new_zeros(rays)
    seen = []
    for first in range(0, count, STRIDE):
        due = (rank >= first) & (rank < first + STRIDE) & ~(absorbed[ray] >= enough)
        now = due.nonzero()[:, 0]
        if now.shape[0] == 0 and first > 0:
            break
        seen.append(_through_field(scene, samples, _chosen(located, now)))
        absorbed = absorbed.index_add(0, ray[now], seen[-1].thickness.detach())
    return _Survivors(
        torch.cat([part.place for part in seen]),
        torch.cat([part.rgb for part in seen]),
        torch.cat([part.thickness for part in seen]),
        sum(part.painted for part in seen),
    )


def _chosen(located: Located, which: Tensor | slice) -> Located:
    directions = None if located.directions is None else located.directions[which]
    return Located(
        located.index[which], located.canonical[which], located.likelihood[which], directions
    )


def _composited(
    samples: _Samples, found: _Survivors, background: Float[Tensor, "3"]
) -> tuple[Int[Tensor, "seen"], Composited]:
    """Rays with survivors, and their colours."""
    rays, count = samples.depths.shape
    ray = found.place // count
    row = torch.zeros(rays, dtype=torch.bool, device=ray.device).index_fill_(0, ray, True)
    seen = row.nonzero()[:, 0]
    place = (row.cumsum(0) - 1)[ray] * count + found.place % count
    thickness = found.thickness.new_zeros(seen.shape[0] * count)
    thickness = thickness.index_copy(0, place, found.thickness)
    rgb = found.rgb.new_zeros(seen.shape[0] * count, 3).index_copy(0, place, found.rgb)
    shape = (seen.shape[0], count)
    return seen, composite(
        rgb.reshape(*shape, 3), thickness.reshape(shape), samples.depths[seen], background
    )


__all__ = ["render", "render_pixels"]
