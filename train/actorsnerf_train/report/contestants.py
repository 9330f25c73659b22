"""Who draws the frames: a fitted actor at its operating points, and its baked forms."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_model.filled_cells import FilledActor
from actorsnerf_model.learned_method import LearnedMethod
from actorsnerf_train.methods import as_published, window_at
from actorsnerf_train.report.measure import Contestant
from actorsnerf_train.report.points import (
    POINTS,
    OperatingPoint,
    PointName,
    at_point,
    skips_empty,
    where_filled,
)
from actorsnerf_train.trained import TrainedActor, load_baked


def chosen_points(names: Sequence[PointName]) -> tuple[OperatingPoint, ...]:
    """The named points after the three that every report needs, or all."""
    always = ("reference", "complete", "exact")
    return tuple(point for point in POINTS if not names or point.name in (*always, *names))


def contestants(
    trained: TrainedActor[Any], points: Sequence[OperatingPoint], baked: Sequence[Path]
) -> list[Contestant]:
    """The actor at each point, then the baked files that show it.

    Raises:
        BakedFileError: no such file, or it is no baked actor.
    """
    asked = any(skips_empty(trained, point) for point in points)
    filled = where_filled(trained) if asked else None
    drawing = [contestant_of(trained, point, filled) for point in points]
    loaded = [load_baked(path, trained.device) for path in baked]
    return drawing + [contestant_of(one) for one in loaded if shows(one, trained)]


def contestant_of(
    trained: TrainedActor[Any],
    point: OperatingPoint | None = None,
    filled: FilledActor[Any] | None = None,
) -> Contestant:
    """An actor at an operating point; without one, a baked actor as its file says.

    Args:
        trained: the actor.
        point: of a fitted actor.
        filled: its filled cells, where they are known.
    """
    if point is None:
        name = f"baked:{trained.path.stem}"
        return Contestant(name, _baked_says(trained), "baked", "float32", trained)
    actor = at_point(trained, point, filled)
    if point.kind == "reference":
        actor = in_published_order(actor)
    return Contestant(point.name, point.says, point.kind, point.precision, actor)


@torch.no_grad()
def in_published_order(trained: TrainedActor[Any]) -> TrainedActor[Any]:
    """The actor as the reference asks it: networks in the published order, the same weights."""
    assert isinstance(trained.method, LearnedMethod)
    published = as_published(trained.method)
    if published is trained.method:
        return trained
    window = window_at(trained.config, trained.info.step)
    state = published.actor_state(trained.supports, window)
    return replace(trained, method=published, state=state)


def shows(baked: TrainedActor[Any], trained: TrainedActor[Any]) -> bool:
    """Whether a baked file was made of this very checkpoint."""
    return baked.info.tensors_sha256 == trained.info.tensors_sha256


def refuse_strangers(
    fitted: Sequence[TrainedActor[Any]], baked: Sequence[TrainedActor[Any]]
) -> None:
    """Nothing, if every baked file was made of one of the checkpoints.

    Raises:
        UserError: one was made of another.
    """
    for one in baked:
        if not any(shows(one, trained) for trained in fitted):
            names = ", ".join(f"{trained.path} ({trained.actor})" for trained in fitted)
            raise UserError(
                f"{one.path}: shows {one.actor} as another checkpoint than {names} has it: bake "
                "again, leave the file out, or report on its checkpoint."
            )


def _baked_says(trained: TrainedActor[Any]) -> str:
    assert trained.baking is not None
    voxel = 1e3 * trained.baking.options.voxel
    return f"baked at {voxel:g} mm, {trained.path.stat().st_size / 1e6:.1f} MB"


__all__ = [
    "chosen_points",
    "contestant_of",
    "contestants",
    "in_published_order",
    "refuse_strangers",
]
