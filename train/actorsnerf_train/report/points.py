"""The named operating points: what each saves, and a fitted actor set to one of them.

`exact` and `complete` show the reference picture to less than one step of an 8-bit colour; the
others say what they change. The report measures all of them on your actor and machine.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_model.filled_cells import FilledActor, SkipEmpty
from actorsnerf_model.learned_method import LearnedMethod
from actorsnerf_model.states import RenderOptions
from actorsnerf_train.config import Precision
from actorsnerf_train.methods import DTYPES
from actorsnerf_train.trained import TrainedActor

Kind = Literal["reference", "exact", "stated", "baked"]
PointName = Literal[
    "reference",
    "complete",
    "exact",
    "stop-1e-2",
    "skip-empty",
    "pixels-by-need",
    "half-samples",
    "quarter-samples",
    "shell-0.05",
    "shell-0.1",
    "bfloat16",
    "fast",
    "fastest",
]
EXACT_STOP = 1e-3
"""Light that `exact` lets go at most: a quarter of 1/255."""
EXACT_WEIGHT = 1e-5
"""Share of a pixel under which `exact` asks for no colour: 128 of it are a third of 1/255."""


@dataclass(frozen=True)
class OperatingPoint:
    """What a name stands for; every default is the training's own."""

    name: PointName
    says: str
    """What it does, for tables."""
    kind: Kind = "stated"
    samples: float = 1.0
    """Samples per ray, as a share of the training's."""
    stop: float = EXACT_STOP
    """`stop_transmittance`."""
    least_weight: float = EXACT_WEIGHT
    """Share of a pixel under which a sample's colour is not computed."""
    threshold: float | None = None
    """Foreground likelihood below which a sample is empty; None: the training's."""
    precision: Precision = "float32"
    """Of products inside the networks."""
    pixel_tolerance: float = 0.0
    """Difference in colour up to which pixels inside the person are interpolated."""
    skip_empty: bool = False
    """Pass over canonical cells where the actor has no density (`filled_cells`); does nothing where
    the method has no canonical space."""


POINTS: tuple[OperatingPoint, ...] = (
    OperatingPoint(
        "reference",
        "every sample through every network, in the published order, float32",
        "reference",
        stop=0.0,
        least_weight=0.0,
    ),
    OperatingPoint(
        "complete",
        "empty space skipped and layers moved; nothing left out",
        "exact",
        stop=0.0,
        least_weight=0.0,
    ),
    OperatingPoint(
        "exact", "also stops behind what is opaque to 0.1 %; no colour for what adds 1e-5", "exact"
    ),
    OperatingPoint("stop-1e-2", "stops behind what is opaque to 1 %", stop=1e-2),
    OperatingPoint("skip-empty", "skips cells that were empty in other poses", skip_empty=True),
    OperatingPoint(
        "pixels-by-need",
        "draws every second pixel, and more where they differ",
        pixel_tolerance=0.1,
    ),
    OperatingPoint("half-samples", "half the samples per ray", samples=0.5),
    OperatingPoint("quarter-samples", "a quarter of the samples per ray", samples=0.25),
    OperatingPoint("shell-0.05", "thinner shell: likelihood from 0.05", threshold=0.05),
    OperatingPoint("shell-0.1", "thinner shell: likelihood from 0.1", threshold=0.1),
    OperatingPoint("bfloat16", "products of the networks in bfloat16", precision="bfloat16"),
    OperatingPoint(
        "fast",
        "skips empty cells, stops at 1 %, pixels by need to 1 %, bfloat16",
        stop=1e-2,
        least_weight=1e-3,
        precision="bfloat16",
        pixel_tolerance=0.01,
        skip_empty=True,
    ),
    OperatingPoint(
        "fastest",
        "the same with half the samples and coarser pixels",
        samples=0.5,
        stop=1e-2,
        least_weight=1e-3,
        precision="bfloat16",
        pixel_tolerance=0.2,
        skip_empty=True,
    ),
)
"""All of them; `reference` first."""


def named_point(name: PointName) -> OperatingPoint:
    """The operating point of a name.

    >>> named_point("exact").stop
    0.001
    """
    return next(point for point in POINTS if point.name == name)


def options_at(point: OperatingPoint, trained: RenderOptions) -> RenderOptions:
    """The options of a point for an actor that was trained with some.

    >>> options_at(named_point("half-samples"), RenderOptions(samples=64)).samples
    32
    """
    return replace(
        trained,
        samples=max(1, round(trained.samples * point.samples)),
        threshold=trained.threshold if point.threshold is None else point.threshold,
        stop_transmittance=point.stop,
        least_weight=point.least_weight,
        pixel_tolerance=point.pixel_tolerance,
    )


def where_filled(trained: TrainedActor[Any]) -> FilledActor[Any]:
    """The actor's state with the cells that `skip_empty` needs: some seconds, once an actor."""
    with torch.no_grad():
        return SkipEmpty(trained.method).filled(
            trained.state, trained.supports, trained.config.render.threshold
        )


def skips_empty(trained: TrainedActor[Any], point: OperatingPoint) -> bool:
    """Whether the point asks for it, and the actor has cells that are the same in all poses."""
    method = trained.method
    return point.skip_empty and isinstance(method, LearnedMethod) and method.canonical_space


def at_point(
    trained: TrainedActor[Any], point: OperatingPoint, filled: FilledActor[Any] | None = None
) -> TrainedActor[Any]:
    """The actor as the point renders it; weights and actor state are shared, not copied.

    Its configuration's `render` holds the point's options, and its method makes the occupied cells
    for the point's threshold.

    Args:
        trained: as it was loaded.
        point: how to render it.
        filled: of `where_filled`; made here if left out.
    """
    options = options_at(point, trained.config.render)
    assert isinstance(trained.method, LearnedMethod)
    method: Any = trained.method.in_precision(DTYPES[point.precision])
    cells = max(method.config.occupancy_threshold, options.threshold)
    method.config = replace(method.config, occupancy_threshold=cells)
    tuned = replace(trained, method=method, config=replace(trained.config, render=options))
    if not skips_empty(trained, point):
        return tuned
    return replace(tuned, method=SkipEmpty(method), state=filled or where_filled(trained))


def at_named_point(trained: TrainedActor[Any], name: PointName | None) -> TrainedActor[Any]:
    """The actor at the point of a name; as it is without one.

    Raises:
        UserError: it is baked, and has no networks left to spare.
    """
    if name is None:
        return trained
    if trained.baking is not None:
        raise UserError(
            f"{trained.path}: is a baked actor, which has one way to be drawn: leave out --point "
            f"{name}, or name the checkpoint that it was baked from."
        )
    return at_point(trained, named_point(name))


__all__ = [
    "EXACT_STOP",
    "POINTS",
    "Kind",
    "OperatingPoint",
    "PointName",
    "at_named_point",
    "at_point",
    "named_point",
    "options_at",
    "skips_empty",
    "where_filled",
]
