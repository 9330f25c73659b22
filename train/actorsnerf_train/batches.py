"""From samples to what the renderer and the losses take: an endless, resumable, shared-out stream.

A sample is a function of (seed, index). Step `s` of a run uses the indices from `s * per_step` on,
dealt out to the processes, so resuming means to begin at a later index, and two processes see
together exactly what one process with twice the accumulation sees.
"""

import dataclasses
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from actorsnerf_datasets.torch_dataset import Sample, View
from actorsnerf_model.constants import constant
from actorsnerf_model.states import Camera

Colour = tuple[float, float, float]
"""Red, green, blue in [0, 1]."""

GENERATOR_STRIDE = 1_000_003
"""Prime; keeps the jitter seeds of neighbouring runs apart."""


@runtime_checkable
class SampleSource(Protocol):
    """What a training reads: a sample for every index."""

    def __getitem__(self, index: int) -> Sample:
        """The sample of an index; a function of it and of the source's seed alone."""
        ...


class _Indexed(Dataset[Sample]):
    """A sample source as torch's loader wants it."""

    def __init__(self, source: SampleSource) -> None:
        self.source = source

    def __getitem__(self, index: int) -> Sample:
        return self.source[index]


@dataclass(frozen=True)
class Share:
    """Which part of every step's samples this process takes."""

    rank: int = 0
    processes: int = 1
    accumulation: int = 1
    """Samples of one process in one step."""

    def indices(self, first_step: int, last_step: int) -> Sequence[int]:
        """Indices of the samples of the steps [first, last).

        >>> Share(rank=1, processes=2, accumulation=2).indices(1, 2)
        [5, 7]
        """
        per_step = self.processes * self.accumulation
        return [
            step * per_step + turn * self.processes + self.rank
            for step in range(first_step, last_step)
            for turn in range(self.accumulation)
        ]


def sample_stream(source: SampleSource, indices: Sequence[int], workers: int) -> Iterator[Sample]:
    """The samples of the indices, in their order, whatever the number of workers; on the host."""
    loader = DataLoader(
        _Indexed(source),
        sampler=indices,
        batch_size=None,
        num_workers=workers,
        generator=torch.Generator(),  # leaves torch's default generator alone
        persistent_workers=False,
    )
    yield from loader


def sample_to(sample: Sample, device: torch.device) -> Sample:
    """The sample with its tensors on a device."""
    return Sample(
        target=view_to(sample.target, device),
        supports=tuple(view_to(view, device) for view in sample.supports),
        patches=sample.patches.to(device, non_blocking=True),
    )


def view_to(view: View, device: torch.device) -> View:
    """The view with its tensors on a device."""
    return dataclasses.replace(
        view,
        image=view.image.to(device, non_blocking=True),
        alpha=view.alpha.to(device, non_blocking=True),
        K=view.K.to(device, non_blocking=True),
        camera_from_body=view.camera_from_body.to(device, non_blocking=True),
        pose=view.pose.to(device, non_blocking=True),
        rest_joints=view.rest_joints.to(device, non_blocking=True),
        rest_vertices=view.rest_vertices.to(device, non_blocking=True),
        posed_vertices=view.posed_vertices.to(device, non_blocking=True),
        canonical_joints=view.canonical_joints.to(device, non_blocking=True),
    )


def camera_of(view: View) -> Camera:
    """The camera of a view's crop."""
    height, width = view.alpha.shape
    return Camera(view.K, view.camera_from_body, (width, height))


def on_background(view: View, background: Colour) -> Float[Tensor, "h w 3"]:
    """The view's picture in front of a colour, as the renderer composes it."""
    alpha = view.alpha[..., None]
    return view.image * alpha + constant(background, view.image) * (1 - alpha)


def at_pixels(
    picture: Float[Tensor, "h w *channels"], pixels: Tensor
) -> Float[Tensor, "*pixels channels"]:
    """A picture's values at integer x, y coordinates (..., 2)."""
    return picture[pixels[..., 1], pixels[..., 0]]


def jitter_generator(seed: int, index: int, device: torch.device) -> torch.Generator:
    """The generator of a sample's jitter along its rays: a function of (seed, index) alone."""
    generator = torch.Generator(device)
    generator.manual_seed(_own_seed(seed, index))
    return generator


def random_background(seed: int, index: int) -> Colour:
    """The colour behind a sample's person: a function of (seed, index) alone, drawn on the host.

    >>> random_background(0, 1) == random_background(0, 1) != random_background(0, 2)
    True
    """
    draw = random.Random(_own_seed(seed, index)).random
    return draw(), draw(), draw()


def _own_seed(seed: int, index: int) -> int:
    return (seed * GENERATOR_STRIDE + index) % 2**63
