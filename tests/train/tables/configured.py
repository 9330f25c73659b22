"""Configurations as a result records them."""

from dataclasses import replace

from actorsnerf_train.config import TrainConfig, fewshot
from actorsnerf_train.records import to_json_object
from actorsnerf_train.result import Json


def tuned(**rates: float) -> TrainConfig:
    """A few-shot fitting with other learning rates."""
    config = fewshot("small")
    return replace(config, rates=replace(config.rates, **rates))


def without(*parts: str) -> dict[str, Json]:
    """That of a fitting without parts of ActorsNeRF."""
    config = fewshot("small")
    model = replace(config.actorsnerf, **dict.fromkeys(parts, False))  # type: ignore[arg-type]  # bool
    return to_json_object(replace(config, model=model))
