"""What a frame's time depends on: the person's pixels, samples, bones, views; not the picture.

The point is `complete`, one frame: every sample in the shell, so that work can be foretold.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRFConfig
from actorsnerf_model.occupancy import occupancy_tables
from actorsnerf_model.skinning_bounds import skinning_bounds
from actorsnerf_model.states import Counts
from actorsnerf_train.methods import build_method
from actorsnerf_train.report.frames import Frame, resized
from actorsnerf_train.report.measure import Contestant, Effort, draw, field_flops, now, spread
from actorsnerf_train.report.rows import PartRow, ScalingRow
from actorsnerf_train.trained import TrainedActor

PICTURES = (1.0, 2.0, 4.0)
"""Sides of the picture, as multiples, around a person who stays as large."""
PERSONS = (0.5, 1.0, 2.0)
"""Sides of the person and the picture, as multiples."""
SAMPLES = (0.25, 0.5, 1.0, 2.0)
"""Samples per ray, as multiples of the training's."""
BONES = (6, 12, 24)
"""Bones that act, those that hold most first."""
UNSHARED = Effort(rounds=1, share=1.0, seed=0)


def scaling_rows(complete: Contestant, frame: Frame, rounds: int) -> tuple[ScalingRow, ...]:
    """The frame in larger pictures, a larger person, more samples and fewer bones, in turns."""
    width, height = frame.camera.size
    cases: list[tuple[str, str, Contestant, Frame]] = []
    for factor in PICTURES:
        size = (round(factor * width), round(factor * height))
        name = f"{size[0]}x{size[1]}"
        cases.append(("picture, same person", name, complete, resized(frame, size, 1.0)))
    for factor in PERSONS:
        size = (round(factor * width), round(factor * height))
        name = f"{size[0]}x{size[1]}"
        cases.append(("person and picture", name, complete, resized(frame, size, factor)))
    for factor in SAMPLES:
        config = complete.actor.config
        samples = max(1, round(factor * config.render.samples))
        options = replace(config.render, samples=samples)
        actor = replace(complete.actor, config=replace(config, render=options))
        one = replace(complete, actor=actor)
        cases.append(("samples per ray", str(samples), one, frame))
    if isinstance(complete.actor.state, ActorsNeRFState):
        cases += [("bones", str(n), _with_bones(complete, n), frame) for n in BONES]
    timed = _in_turns([(who, what) for _, _, who, what in cases], rounds)
    return tuple(
        ScalingRow(varied, value, spread(times).median, counts.rays, counts.survivors)
        for (varied, value, _, _), (times, counts) in zip(cases, timed, strict=True)
    )


def part_rows(
    trained: TrainedActor[Any], complete: Contestant, frame: Frame, rounds: int
) -> tuple[PartRow, ...]:
    """The frame by the same method without one of its parts, and with fewer views, in turns.

    Random weights in all rows, but the trained skinning volume: the same samples reach the
    networks, and all get a colour. No rows for a method without these parts.
    """
    model = trained.config.model
    if not isinstance(model, ActorsNeRFConfig):
        return ()
    cases = [("nothing", _rebuilt(trained, complete, model))]
    without = {
        "deformation": replace(model, deformation=False),
        "pixel features": replace(model, pixel_features=False),
        "body features": replace(model, body_features=False),
    }
    for name, changed in without.items():
        if changed != model:
            cases.append((name, _rebuilt(trained, complete, changed)))
    for views in range(1, model.views):
        changed = replace(model, views=views)
        what = f"views: {views} of {model.views}"
        cases.append((what, _rebuilt(trained, complete, changed)))
    timed = _in_turns([(who, frame) for _, who in cases], rounds)
    rows = []
    for (name, who), (times, counts) in zip(cases, timed, strict=True):
        flops = field_flops(who, frame)
        rows.append(PartRow(name, spread(times), flops.density, flops.colour, counts.survivors))
    return tuple(rows)


@torch.no_grad()
def _with_bones(complete: Contestant, count: int) -> Contestant:
    """The contestant whose other bones hold nothing: where they did, the actor is not."""
    state = complete.actor.state
    volume = state.body.skinning
    held = volume.weights.flatten(1).sum(1)
    acts = torch.zeros_like(held).index_fill_(0, held.topk(count).indices, 1.0)
    volume = replace(volume, weights=volume.weights * acts[:, None, None, None])
    bounds = skinning_bounds(volume)
    tables = occupancy_tables(volume, bounds)
    body = replace(state.body, skinning=volume, bounds=bounds, occupancy=tables)
    actor = replace(complete.actor, state=replace(state, body=body))
    return replace(complete, actor=actor)


@torch.no_grad()
def _rebuilt(
    trained: TrainedActor[Any], complete: Contestant, model: ActorsNeRFConfig
) -> Contestant:
    """The contestant with another model of the same skinning volume, at its own precision."""
    config = replace(trained.config, model=model, precision=complete.precision)
    method = build_method(config, trained.device)
    source: Any = trained.method
    method.parts()["skinning"].load_state_dict(source.skinning.state_dict())
    method.eval()
    supports = trained.supports[: model.views]
    state = method.actor_state(supports, trained.state.window)
    actor = replace(complete.actor, method=method, state=state, supports=supports)
    return replace(complete, actor=actor)


def _in_turns(
    cases: Sequence[tuple[Contestant, Frame]], rounds: int
) -> list[tuple[list[float], Counts]]:
    """Each case's times and work, after a warm-up."""
    counts = [draw(who, frame, UNSHARED).rendering.counts for who, frame in cases]
    times: list[list[float]] = [[] for _ in cases]
    for turn in range(rounds):
        for i in range(len(cases)):
            number = (i + turn) % len(cases)
            who, frame = cases[number]
            device = frame.pose.device
            began = now(device)
            draw(who, frame, UNSHARED)
            times[number].append(now(device) - began)
    return list(zip(times, counts, strict=True))


__all__ = ["BONES", "PERSONS", "PICTURES", "SAMPLES", "part_rows", "scaling_rows"]
