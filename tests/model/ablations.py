"""Every choice of ActorsNeRF's parts, at the smallest sizes."""

from dataclasses import replace

from actorsnerf_model.actorsnerf import ActorsNeRFConfig
from actorsnerf_model.presets import TINY

ABLATIONS = [
    replace(TINY, deformation=a, pixel_features=b, body_features=c)
    for a in (True, False)
    for b in (True, False)
    for c in (True, False)
]


def name(config: ActorsNeRFConfig) -> str:
    """For the tests' names: the parts that are there."""
    parts = ("deformation", "pixel_features", "body_features")
    return "+".join(part for part in parts if getattr(config, part)) or "nothing"
