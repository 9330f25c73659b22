"""The reference renderer: all samples, all bones, every network on every sample, masked afterwards.

Slow and plain on purpose: it is the oracle of `render` and what its speed is measured against. It
shares with it only what defines the picture: the rays, the bounds, and where samples lie.
"""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.rays import Rays, draw_jitter, intersect_box, sample_depths, unit
from actorsnerf_model.states import (
    ActorState,
    Counts,
    FieldValues,
    Located,
    Method,
    PoseState,
    Rendering,
    RenderOptions,
)


def reference_render_pixels(
    method: Method[ActorState],
    actor: ActorState,
    pose: PoseState,
    rays: Rays,
    options: RenderOptions,
    generator: torch.Generator | None = None,
) -> Rendering:
    """The colours of rays, (rays,), without any saving; in float64 if the states are.

    A threshold of 0 makes `locate` return every point; the test follows here. All options that
    save work are ignored.

    Args:
        method: the model.
        actor: its `actor_state`.
        pose: its `pose_state`.
        rays: in the posed body frame.
        options: samples, threshold, background and mask.
        generator: jitters the samples; None spaces them evenly.
    """
    count, samples = rays.directions.shape[0], options.samples
    jitter = draw_jitter(rays, samples, generator)
    span = intersect_box(rays, pose.bounds)
    depths = sample_depths(span.near, span.far, samples, jitter)
    points = rays.origin + depths[:, :, None] * rays.directions[:, None]
    towards = unit(rays.directions).repeat_interleave(samples, 0)
    located, values = _everything(
        (method, actor, pose), points.reshape(-1, 3), towards, options.chunk
    )
    likelihood = located.likelihood.reshape(count, samples)
    person = (likelihood >= options.threshold) & span.hit[:, None]
    density = torch.where(person, values.density.reshape(count, samples), 0)
    rgb = values.rgb.reshape(count, samples, 3)
    stops = (span.far - span.near) / max(samples - 1, 1)
    light = torch.ones_like(span.near)
    colour = torch.zeros_like(rays.directions)
    alpha, distance = torch.zeros_like(light), torch.zeros_like(light)
    for sample in range(samples):
        last = sample == samples - 1
        step = stops if last else depths[:, sample + 1] - depths[:, sample]
        length = step * rays.directions.norm(dim=-1)
        opacity = 1 - torch.exp(-density[:, sample] * length)
        if options.soft_mask:
            # Two bones can claim one point, so likelihoods go beyond 1; opacities must not.
            opacity = (opacity * likelihood[:, sample]).clamp(max=1)
        weight = light * opacity
        light = light * (1 - opacity)
        colour = colour + weight[:, None] * rgb[:, sample]
        alpha = alpha + weight
        distance = distance + weight * depths[:, sample]
    colour = colour + light[:, None] * colour.new_tensor(options.background)
    hits = int(span.hit.sum())
    return Rendering(colour, alpha, distance, Counts(hits, hits * samples, *[count * samples] * 2))


def _everything(
    scene: tuple[Method[ActorState], ActorState, PoseState],
    points: Float[Tensor, "points 3"],
    directions: Float[Tensor, "points 3"],
    chunk: int,
) -> tuple[Located, FieldValues]:
    """Every point located and through the field, `chunk` points at a time."""
    method, actor, pose = scene
    located, values = [], []
    for part, seen in zip(torch.split(points, chunk), torch.split(directions, chunk), strict=True):
        located.append(method.locate(actor, pose, part, 0.0))
        assert located[-1].index.shape[0] == part.shape[0], "threshold 0 must keep every point"
        values.append(method.field(actor, pose, replace(located[-1], directions=seen)))
    return (
        Located(
            torch.arange(points.shape[0], device=points.device),
            torch.cat([part.canonical for part in located]),
            torch.cat([part.likelihood for part in located]),
        ),
        FieldValues(
            torch.cat([part.rgb for part in values]).to(points.dtype),
            torch.cat([part.density for part in values]).to(points.dtype),
        ),
    )


__all__ = ["reference_render_pixels"]
