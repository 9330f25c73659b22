"""What a training is called in tables: its method, and what was left out of it."""

from collections.abc import Mapping, Sequence

from actorsnerf_train.result import Json

PARTS = {
    "deformation": "deformation",
    "pixel_features": "pixel features",
    "body_features": "SMPL features",
}
"""Of ActorsNeRF, as its configuration and the paper name them."""
METHODS = {"actorsnerf": "ActorsNeRF", "humannerf": "HumanNeRF", "neuralbody": "Neural Body"}


def label_from(method: str, without: Sequence[str], scratch: bool) -> str:
    """A training's name.

    >>> label_from("actorsnerf", ["deformation"], scratch=True)
    'ActorsNeRF, no deformation, from scratch'
    """
    name = METHODS.get(method, method)
    if method != "actorsnerf":
        return name
    notes = [f"no {PARTS[part]}" for part in without]
    return ", ".join([name, *notes, *(["from scratch"] if scratch else [])])


def left_out(configuration: Mapping[str, Json]) -> tuple[str, ...]:
    """The parts that a training's configuration switches off.

    >>> left_out({"model": {"deformation": False, "pixel_features": True}})
    ('deformation',)
    """
    model = configuration.get("model")
    return tuple(part for part in PARTS if isinstance(model, dict) and model.get(part) is False)
