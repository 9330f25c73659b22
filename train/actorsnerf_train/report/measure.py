"""What each contestant takes and gives: times taken in turns, work, and pictures to compare.

In every round each contestant draws every frame, one after the other, so that a slow phase of the
machine hits all of them; a round's time is the mean over its frames, and ratios are of medians.
Who is done at once draws again for a while: the one before has left cold caches and used memory
behind, which neither a video nor a training meets.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode
from tqdm import tqdm

from actorsnerf_model.cores import on_all_cores
from actorsnerf_model.pieces import at_once
from actorsnerf_model.rays import Rays, rays_through
from actorsnerf_model.reference import reference_render_pixels
from actorsnerf_model.states import Counts, PoseState, Rendering
from actorsnerf_train.config import Precision
from actorsnerf_train.methods import DTYPES
from actorsnerf_train.report.frames import Frame
from actorsnerf_train.report.points import Kind
from actorsnerf_train.trained import TrainedActor
from actorsnerf_train.trained import draw as draw_actor

REFERENCE_RAYS = 256
"""Rays that the reference lays out at once, on a CPU: bounds its memory, and gives every core as
much work."""
CHUNKS = (2048, 4096, 16384, 65536)
"""Points through the networks at once, of which the reference takes the fastest."""
GEMM = 4096, 512, 512
"""Rows, inputs and outputs of the product that measures what the machine can do."""
GEMM_REPEATS = 8
BRIEF = 2.0
"""Seconds for which a contestant draws in a round at least."""
TURNS = 3
"""Times that it draws in a round at least, if they take no longer than `LONG`."""
LONG = 10.0
"""Seconds after which nobody begins another turn of the round."""


@dataclass(frozen=True)
class Contestant:
    """Somebody who draws the frames: an operating point of the actor, or a baked form of it."""

    name: str
    says: str
    kind: Kind
    precision: Precision
    actor: TrainedActor[Any]
    """Its `config.render` is how to spend work."""


@dataclass(frozen=True)
class Drawn:
    """What a contestant drew of one frame."""

    rendering: Rendering
    """Of whole pictures (height, width); of the reference the share's pixels (rays,)."""
    pixels: Int[Tensor, "rays 2"] | None
    """x, y of the reference's share; None: the whole picture."""


@dataclass(frozen=True)
class Spread:
    """Repeated times, seconds."""

    median: float
    low: float
    """First quartile."""
    high: float
    """Third quartile."""


@dataclass(frozen=True)
class Products:
    """Floating-point operations of the networks' matrix products for one sample."""

    density: float
    """Until its density is known."""
    colour: float
    """For its colour, in addition."""


@dataclass(frozen=True)
class Measured:
    """What one run found of a contestant."""

    contestant: Contestant
    drawn: tuple[Drawn, ...]
    """Frame by frame."""
    times: Spread
    """Of a whole frame; the reference's are scaled up from its share of the rays."""
    flops: Products
    """What one sample needs in the networks."""
    limit: float
    """Multiply-adds times two per second that this machine's products reached before all turns at
    the contestant's precision; their median."""

    @property
    def survivors(self) -> float:
        """Samples of a frame that went through networks, mean."""
        return self._mean([drawn.rendering.counts.survivors for drawn in self.drawn])

    @property
    def painted(self) -> float:
        """Samples of a frame whose colour was computed, mean."""
        return self._mean([drawn.rendering.counts.painted for drawn in self.drawn])

    @property
    def samples(self) -> float:
        """Samples of a frame on rays that met the bounds, mean."""
        return self._mean([drawn.rendering.counts.samples for drawn in self.drawn])

    @property
    def rays(self) -> float:
        """Rays of a frame that met the bounds, mean."""
        return self._mean([drawn.rendering.counts.rays for drawn in self.drawn])

    @property
    def of_limit(self) -> float:
        """Share of the arithmetic limit: time that the products alone need, over the time."""
        needed = self.survivors * self.flops.density + self.painted * self.flops.colour
        return needed / self.limit / self.times.median

    def _mean(self, counts: list[int]) -> float:
        return sum(counts) / len(counts)


@dataclass(frozen=True)
class Effort:
    """How thoroughly to measure."""

    rounds: int
    share: float
    """Of the rays in the body's box, that the reference draws."""
    seed: int


def draw(contestant: Contestant, frame: Frame, effort: Effort) -> Drawn:
    """The frame as the contestant draws it, the pose's own work included."""
    return draw_posed(contestant, frame, posed(contestant, frame), effort)


@torch.no_grad()
def posed(contestant: Contestant, frame: Frame) -> PoseState:
    """The actor's state in the frame's pose."""
    actor = contestant.actor
    pose: PoseState = actor.method.pose_state(actor.state, frame.pose, frame.rest_joints)
    return pose


@torch.no_grad()
def draw_posed(contestant: Contestant, frame: Frame, pose: PoseState, effort: Effort) -> Drawn:
    """The frame of an actor that is posed already."""
    actor = contestant.actor
    options = actor.config.render
    if contestant.kind != "reference":
        return Drawn(draw_actor(actor, pose, frame.camera, options), None)
    pixels = shared_pixels(frame, effort)
    rays = rays_through(pixels.to(frame.camera.K), frame.camera)

    def seen(part: Float[Tensor, "rays 3"]) -> Rendering:
        some = Rays(rays.origin, part)
        return reference_render_pixels(actor.method, actor.state, pose, some, options)

    device = rays.directions.device
    parts = torch.split(rays.directions, at_once(REFERENCE_RAYS, device))
    pieces = on_all_cores(seen, parts, device)
    return Drawn(_joined(pieces), pixels)


def shared_pixels(frame: Frame, effort: Effort) -> Int[Tensor, "rays 2"]:
    """The box's pixels that the reference draws: a fixed random share of them."""
    inside = frame.box.nonzero().flip(-1)
    count = max(1, round(effort.share * inside.shape[0]))
    generator = torch.Generator().manual_seed(effort.seed)
    chosen = torch.randperm(inside.shape[0], generator=generator)[:count].sort().values
    return inside[chosen]


def measure(
    contestants: Sequence[Contestant], frames: Sequence[Frame], effort: Effort
) -> tuple[Measured, ...]:
    """Every contestant measured on every frame, in turns, after a warm-up that is kept to compare.

    Args:
        contestants: who draws.
        frames: what.
        effort: how often, and how much the reference draws.
    """
    contestants = [_with_best_chunk(one, frames[0], effort) for one in contestants]
    drawn = [
        tuple(draw(one, frame, effort) for frame in frames)
        for one in tqdm(contestants, desc="pictures", unit="point", leave=False)
    ]
    times: list[list[float]] = [[] for _ in contestants]
    rates: dict[Precision, list[float]] = {one.precision: [] for one in contestants}
    for turn in tqdm(range(effort.rounds), desc="times", unit="round", leave=False):
        for i in range(len(contestants)):
            who = (i + turn) % len(contestants)
            precision = contestants[who].precision
            rates[precision].append(gemm_rate(precision, frames[0].pose.device))
            times[who].append(_round(contestants[who], frames, effort))
    return tuple(
        Measured(
            one,
            _scaled_up(own, frames),
            spread(took),
            field_flops(one, frames[0]),
            statistics.median(rates[one.precision]),
        )
        for one, own, took in zip(contestants, drawn, times, strict=True)
    )


def settled(turn: Callable[[], float]) -> float:
    """The median of what a round's turns tell; what takes long has one turn.

    Args:
        turn: does the work and tells the seconds it took.
    """
    began = time.perf_counter()
    told: list[float] = []
    passed = 0.0
    while not told or passed < BRIEF or (len(told) < TURNS and passed < LONG):
        told.append(turn())
        passed = time.perf_counter() - began
    return statistics.median(told)


def spread(times: Sequence[float]) -> Spread:
    """Median and quartiles.

    >>> spread([1.0, 2.0, 3.0])
    Spread(median=2.0, low=1.5, high=2.5)
    """
    values = torch.tensor(times, dtype=torch.float64)
    low, middle, high = torch.quantile(values, values.new_tensor([0.25, 0.5, 0.75])).tolist()
    return Spread(middle, low, high)


@torch.no_grad()
def field_flops(contestant: Contestant, frame: Frame) -> Products:
    """What one sample needs in the field."""
    actor = contestant.actor
    pose = posed(contestant, frame)
    low, high = pose.bounds
    shares = torch.rand(20_000, 3, generator=torch.Generator().manual_seed(0)).to(low)
    points = low + shares * (high - low)
    located = actor.method.locate(actor.state, pose, points, actor.config.render.threshold)
    count = located.index.shape[0]
    if count == 0:
        return Products(0.0, 0.0)
    density, colour = FlopCounterMode(display=False), FlopCounterMode(display=False)
    with density:
        field = actor.method.field(actor.state, pose, located)
    with colour:
        field.colours(torch.arange(count, device=points.device))
    return Products(density.get_total_flops() / count, colour.get_total_flops() / count)


@torch.no_grad()
def gemm_rate(precision: Precision, device: torch.device) -> float:
    """Floating-point operations per second of a large matrix product."""
    rows, inputs, outputs = GEMM
    dtype = DTYPES[precision]
    left = torch.ones(rows, inputs, dtype=dtype, device=device)
    right = torch.ones(inputs, outputs, dtype=dtype, device=device)
    out = torch.empty(rows, outputs, dtype=dtype, device=device)
    torch.mm(left, right, out=out)
    began = now(device)
    for _ in range(GEMM_REPEATS):
        torch.mm(left, right, out=out)
    return 2 * rows * inputs * outputs * GEMM_REPEATS / (now(device) - began)


def now(device: torch.device) -> float:
    """Seconds, once the device has done what it was asked."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()


def _round(contestant: Contestant, frames: Sequence[Frame], effort: Effort) -> float:
    """Seconds of a frame in one round, mean over the frames."""

    def turn() -> float:
        took = [_seconds(contestant, frame, effort) for frame in frames]
        return sum(took) / len(took)

    return settled(turn)


def _seconds(contestant: Contestant, frame: Frame, effort: Effort) -> float:
    """Time of the whole frame: the pose's once, and that of a share of the rays as of all."""
    device = frame.pose.device
    began = now(device)
    pose = posed(contestant, frame)
    ready = now(device)
    drawn = draw_posed(contestant, frame, pose, effort)
    took = now(device) - ready
    whole = took if drawn.pixels is None else took * _unshared(drawn, frame)
    return ready - began + whole


def _unshared(drawn: Drawn, frame: Frame) -> float:
    assert drawn.pixels is not None
    return float(frame.box.sum()) / drawn.pixels.shape[0]


def _scaled_up(drawn: Sequence[Drawn], frames: Sequence[Frame]) -> tuple[Drawn, ...]:
    """The reference's work as that of the whole frame."""
    whole = []
    for one, frame in zip(drawn, frames, strict=True):
        if one.pixels is None:
            whole.append(one)
            continue
        factor, counts = _unshared(one, frame), one.rendering.counts
        scaled = Counts(
            *(
                round(count * factor)
                for count in (counts.rays, counts.samples, counts.survivors, counts.painted)
            )
        )
        whole.append(replace(one, rendering=replace(one.rendering, counts=scaled)))
    return tuple(whole)


def _with_best_chunk(contestant: Contestant, frame: Frame, effort: Effort) -> Contestant:
    """The reference with the chunk size that suits this machine; the others as they are."""
    if contestant.kind != "reference":
        return contestant
    tried = {}
    fewer = replace(effort, share=effort.share / len(CHUNKS))
    for chunk in CHUNKS:
        config = contestant.actor.config
        options = replace(config.render, chunk=chunk)
        one = replace(
            contestant, actor=replace(contestant.actor, config=replace(config, render=options))
        )
        tried[_seconds(one, frame, fewer)] = one
    return tried[min(tried)]


def _joined(pieces: list[Rendering]) -> Rendering:
    return Rendering(
        torch.cat([piece.rgb for piece in pieces]),
        torch.cat([piece.alpha for piece in pieces]),
        torch.cat([piece.depth for piece in pieces]),
        Counts.total([piece.counts for piece in pieces]),
    )


__all__ = [
    "Contestant",
    "Drawn",
    "Effort",
    "Measured",
    "Products",
    "Spread",
    "draw",
    "field_flops",
    "gemm_rate",
    "measure",
    "now",
    "settled",
    "shared_pixels",
    "spread",
]
