"""Error against time: a few evaluation pictures measured at stated steps of a fitting.

Nothing of the training is changed by it, and nothing is chosen by it: neither steps nor rates nor
checkpoints look at what was measured.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.selection import find_protocol
from actorsnerf_model.states import RenderOptions
from actorsnerf_train.evaluate import published_lpips
from actorsnerf_train.judge import Judgement, judge
from actorsnerf_train.lpips import LpipsFiles
from actorsnerf_train.metrics import ConventionName, mean_scores
from actorsnerf_train.places import few_places
from actorsnerf_train.result import CurvePoint
from actorsnerf_train.trained import TrainedActor

FRACTIONS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Of the run's steps, after which is measured."""
PICTURES = 6
CONVENTION: ConventionName = "box"


@dataclass(frozen=True)
class Gauge:
    """The pictures that a fitting is measured on, and how."""

    data: Path
    places: tuple[tuple[int, int], ...]
    """(camera, frame) positions."""
    judgement: Judgement

    def measure(self, trained: TrainedActor[Any], seconds: float) -> CurvePoint:
        """How good the actor is after so many seconds of training."""
        with SequenceFile(self.data) as file:
            judged = [judge(trained, file, place, self.judgement) for place in self.places]
            names = [camera.name for camera in file.header.cameras]
            pictures = [(names[c], int(file.header.frames[f])) for c, f in self.places]
        mean = mean_scores([one.scores[CONVENTION] for one in judged])
        return CurvePoint(
            step=trained.info.step,
            seconds=seconds,
            convention=CONVENTION,
            psnr=mean.psnr,
            ssim=mean.ssim,
            lpips_x1000=mean.lpips_x1000,
            pictures=tuple(pictures),
        )


def make_gauge(
    data: Path, protocol: str, render: RenderOptions, lpips: LpipsFiles, device: torch.device
) -> Gauge:
    """What measures fittings to the actor of a file; torch's generator is as it was.

    Args:
        data: prepared file of the actor.
        protocol: named protocol of the file, whose evaluation pictures these are.
        render: as the training's evaluation will render.
        lpips: the user's own weights.
        device: of the training.

    Raises:
        UserError: no such protocol, or it has no valid picture.
    """
    with SequenceFile(data) as file:
        places = few_places(file, find_protocol(file, protocol), PICTURES)
    with torch.random.fork_rng(devices=[]):  # a network's first weights are drawn, then replaced
        distance = published_lpips(lpips, device)
    return Gauge(data, places, Judgement((CONVENTION,), render, distance))


def curve_steps(steps: int) -> frozenset[int]:
    """The steps of a run after which is measured.

    >>> sorted(curve_steps(500))
    [10, 25, 50, 100, 200, 300, 400, 500]
    """
    return frozenset(max(1, round(share * steps)) for share in FRACTIONS)
