"""The only place where pixels become rays, and rays become sample positions.

A ray is origin + t direction with a direction of length 1 along the optical axis, so t is the
depth in metres, and a distance along the ray is t times the direction's length.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_model.projection import NEAR_PLANE
from actorsnerf_model.states import Camera

PARALLEL = 1e-12
"""A direction's component under which a ray counts as parallel to a face: it drifts a nanometre in
a kilometre, and the gradient, whose divisor is its square, stays finite in float32."""


@dataclass(frozen=True)
class Rays:
    """Rays of one camera."""

    origin: Float[Tensor, "3"]
    """The camera's centre, body frame, metres."""
    directions: Float[Tensor, "rays 3"]
    """Body frame; their component along the optical axis is 1."""


@dataclass(frozen=True)
class Span:
    """Where rays run inside a box."""

    near: Float[Tensor, "rays"]
    """Depth of the entry, metres; at least `NEAR_PLANE`. 0 where the box is missed."""
    far: Float[Tensor, "rays"]
    """Depth of the exit; 0 where the box is missed."""
    hit: Bool[Tensor, "rays"]
    """True where a stretch of positive length lies inside and before the camera."""


def rays_through(pixels: Float[Tensor, "rays 2"], camera: Camera) -> Rays:
    """The rays through pixel coordinates.

    Args:
        pixels: x, y; the centre of the top-left pixel is (0, 0).
        camera: seen from the body frame.
    """
    rotation, translation = camera.camera_from_body[:3, :3], camera.camera_from_body[:3, 3]
    homogeneous = torch.cat([pixels, torch.ones_like(pixels[:, :1])], -1)
    with torch.autocast(pixels.device.type, enabled=False):
        # `inv` would ask a GPU whether K is singular, and wait for its answer.
        directions = homogeneous @ torch.linalg.inv_ex(camera.K).inverse.T @ rotation
        return Rays(-translation @ rotation, directions)


def unit(directions: Float[Tensor, "rays 3"]) -> Float[Tensor, "rays 3"]:
    """The directions at length 1; one without length stays zero, and its gradient finite."""
    length: Tensor = torch.linalg.vector_norm(directions, dim=-1, keepdim=True)
    return directions / length.clamp(min=PARALLEL)


def intersect_box(rays: Rays, box: Float[Tensor, "2 3"]) -> Span:
    """The stretch of each ray inside a box, by slabs.

    A ray parallel to a face is inside that slab or never meets it; faces belong to the box. A box
    behind the camera is missed, and a camera inside the box sees from `NEAR_PLANE` on. The released
    code counts faces met (drops rays through edges and corners), meets boxes behind the camera, and
    widens the box by 1 cm against rounding.
    """
    origin, directions = rays.origin, rays.directions
    parallel = directions.abs() < PARALLEL
    divisor = torch.where(parallel, torch.ones_like(directions), directions)
    low, high = (box[0] - origin) / divisor, (box[1] - origin) / divisor
    within = (origin >= box[0]) & (origin <= box[1])
    infinite = torch.full_like(low, torch.inf)
    enter = torch.where(parallel, torch.where(within, -infinite, infinite), low.minimum(high))
    leave = torch.where(parallel, torch.where(within, infinite, -infinite), low.maximum(high))
    near = enter.amax(-1).clamp(min=NEAR_PLANE)
    far = leave.amin(-1)
    hit = (far > near) & torch.isfinite(far)
    zero = torch.zeros_like(near)
    return Span(torch.where(hit, near, zero), torch.where(hit, far, zero), hit)


def sample_depths(
    near: Float[Tensor, "rays"],
    far: Float[Tensor, "rays"],
    samples: int,
    jitter: Float[Tensor, "rays samples"] | None,
) -> Float[Tensor, "rays samples"]:
    """Ascending sample depths from near to far, metres.

    Args:
        near: metres.
        far: metres.
        samples: per ray; evenly spaced with both ends, or the one in the middle.
        jitter: in [0, 1): where in its stratum each sample lies instead; a stratum reaches half
            way to the neighbours, and to the end at the ends.

    Source: released code (stratified sampling when training, none at test).
    """
    steps = torch.linspace(0, 1, samples, dtype=near.dtype, device=near.device)
    if samples == 1:
        steps = steps + 0.5
    even = near[:, None] + (far - near)[:, None] * steps
    if jitter is None:
        return even
    middle = (even[:, 1:] + even[:, :-1]) / 2
    low = torch.cat([near[:, None], middle], -1)
    high = torch.cat([middle, far[:, None]], -1)
    return low + (high - low) * jitter


def draw_jitter(
    rays: Rays, samples: int, generator: torch.Generator | None
) -> Float[Tensor, "rays samples"] | None:
    """The places of all samples in their strata, in [0, 1); None without a generator.

    Drawn for all rays, also those that miss, so that a ray's samples do not depend on the bounds;
    drawn in float32 whatever the rays are, so that one seed gives the same places in float64.
    """
    if generator is None:
        return None
    size = rays.directions.shape[0], samples
    drawn = torch.rand(size, generator=generator, device=generator.device, dtype=torch.float32)
    return drawn.to(rays.directions)


def spacings(
    depths: Float[Tensor, "rays samples"],
    near: Float[Tensor, "rays"],
    far: Float[Tensor, "rays"],
    rays: Rays,
) -> Float[Tensor, "rays samples"]:
    """Length of the ray that each sample stands for, metres.

    The last sample stands for one regular spacing of its ray. (Released code: 1e-10, so that the
    last sample adds nothing; HumanNeRF: 1e10, so that it is opaque at any density.)

    Args:
        depths: ascending.
        near: of each ray, metres.
        far: of each ray, metres.
        rays: the lengths of their directions turn depth into distance.
    """
    regular = (far - near) / max(depths.shape[1] - 1, 1)
    steps = torch.cat([depths[:, 1:] - depths[:, :-1], regular[:, None]], -1)
    lengths: Tensor = torch.linalg.vector_norm(rays.directions, dim=-1, keepdim=True)
    return steps * lengths


__all__ = [
    "Rays",
    "Span",
    "draw_jitter",
    "intersect_box",
    "rays_through",
    "sample_depths",
    "spacings",
    "unit",
]
