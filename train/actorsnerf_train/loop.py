"""The training loop, for category training and few-shot fitting alike; read `train` first.

A step is a function of the weights, the optimiser's memory, the seed and the step's number. So 2N
steps equal N steps, a kill and another N, bit for bit on a CPU.
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from tqdm import tqdm

from actorsnerf_datasets.torch_dataset import Sample, View
from actorsnerf_train.batches import (
    SampleSource,
    Share,
    jitter_generator,
    random_background,
    sample_stream,
    sample_to,
)
from actorsnerf_train.checkpoint import FOLDER, STEM, CheckpointError, checkpoint_path
from actorsnerf_train.curve import Gauge, curve_steps
from actorsnerf_train.curve_file import add_point, begin_curve, read_curve, write_curve
from actorsnerf_train.distributed import Team, gathering, shared
from actorsnerf_train.health import Health
from actorsnerf_train.journal import Journal
from actorsnerf_train.losses import Perceptual
from actorsnerf_train.means import Means
from actorsnerf_train.methods import AnyMethod, KnownActor, know_actor, window_at
from actorsnerf_train.objective import Objective, Outcome
from actorsnerf_train.optimiser import adam, set_rates
from actorsnerf_train.pictures import write_png
from actorsnerf_train.run_folder import RunFolder
from actorsnerf_train.saving import Learner, checkpoint_info, restore, save
from actorsnerf_train.schedule import due
from actorsnerf_train.snapshot import snapshot
from actorsnerf_train.trained import TrainedActor, load_trained

SNAPSHOTS = "pictures"


@dataclass(frozen=True)
class Training:
    """A training that is ready to begin."""

    folder: RunFolder
    method: AnyMethod
    """On the device, with the weights to begin from."""
    source: SampleSource
    perceptual: Perceptual
    device: torch.device
    team: Team = field(default_factory=Team)
    supports: tuple[View, ...] = ()
    """Of the one actor of a few-shot fitting; empty where each sample brings its own."""
    workers: int = 0
    """Processes that load samples."""
    gauge: Gauge | None = None
    """Of a few-shot fitting whose error against time is wanted."""

    def say(self, sentence: str) -> None:
        """Tell the user; only the leading process does."""
        if self.team.leads:
            tqdm.write(sentence)

    def on_device(self, drawn: Sample) -> Sample:
        """The sample with its tensors on the device and the supports it is trained with."""
        sample = sample_to(drawn, self.device)
        return replace(sample, supports=self.supports) if self.supports else sample


def train(training: Training) -> Path:
    """The last checkpoint (its JSON file) of the training, newly begun or gone on with.

    Raises:
        TrainingError: the loss is no number any more, or the actor has collapsed.
    """
    config, team = training.folder.config, training.team
    learner = _learner(training)
    first, seconds_before = restore(training.folder, learner, team.leads)
    last, every = config.schedule.steps, config.every
    stride = _Stride(training, learner, first)
    measured = _begin_measuring(training, first)
    journal = Journal(
        training.folder.path if team.leads else None, training.perceptual.name, first, last
    )
    with journal:
        for step in range(first, last):
            rate = set_rates(learner.optimiser, config.schedule, step)
            window = window_at(config, step)
            actor = stride.take(step, window)
            journal.advance()
            done, seconds = step + 1, seconds_before + journal.seconds()
            if due(done, every.log, last):
                journal.record(stride.means.entry(done, actor, rate, window, seconds))
            if done in measured:
                with journal.not_training():
                    _measure(training, learner, done, seconds)
            if team.leads and due(done, every.checkpoint, last):
                save(training.folder, learner, done, seconds)
            if team.leads and due(done, every.picture, last):
                _picture(training, stride.actors, window, done)
    team.wait()
    return checkpoint_path(training.folder.path)


def known_actor(
    actors: dict[bytes, KnownActor], method: AnyMethod, drawn: Sample, supports: tuple[View, ...]
) -> KnownActor:
    """What is kept of the sample's actor; two sequences of one person differ in shape a little.

    Args:
        actors: those known so far; grows.
        method: to be trained.
        drawn: the sample on the host, where its actor is recognised without asking the device.
        supports: the sample's, on the method's device.
    """
    shape = drawn.target.canonical_joints.numpy().tobytes()
    if shape not in actors:
        actors[shape] = know_actor(method, supports)
    return actors[shape]


class _Stride:
    """One step after the other: samples in, changed weights out."""

    def __init__(self, training: Training, learner: Learner, first: int) -> None:
        config, team = training.folder.config, training.team
        self.training = training
        self.learner = learner
        self.objective = shared(
            Objective(training.method, training.perceptual, config.losses, config.render), team
        )
        share = Share(team.rank, team.processes, config.accumulation)
        indices = share.indices(first, config.schedule.steps)
        stream = sample_stream(training.source, indices, training.workers)
        self.samples = zip(indices, stream, strict=True)
        self.actors: dict[bytes, KnownActor] = {}
        self.health = Health(config.health)
        self.means = Means()

    def take(self, step: int, window: float) -> str:
        """Take one step; the name of its last actor."""
        config = self.training.folder.config
        for turn in range(config.accumulation):
            index, drawn = next(self.samples)
            sample = self.training.on_device(drawn)
            known = known_actor(self.actors, self.training.method, drawn, sample.supports)
            jitter = jitter_generator(config.seed, index, self.training.device)
            random = config.background == "random"
            background = random_background(config.seed, index) if random else None
            with gathering(self.objective, last=turn == config.accumulation - 1):
                outcome: Outcome = self.objective(sample, known, window, jitter, background)
                self.learner.backward(outcome.losses.total / config.accumulation)
            self.health.check(self.means.add(outcome), step, sample.target.actor)
        if step + 1 == config.schedule.steps:
            self.health.conclude(step)
        self.learner.step()
        return sample.target.actor


def _learner(training: Training) -> Learner:
    config, method = training.folder.config, training.method
    method.train()
    if config.freeze_category:
        method.freeze_category_prior()
    optimiser = adam(method.parts(), config.rates)
    scaler = torch.amp.GradScaler(training.device.type, enabled=config.precision == "float16")
    return Learner(method, optimiser, scaler, training.supports)


def _begin_measuring(training: Training, first: int) -> frozenset[int]:
    """The steps after which this process measures; what was passed unmeasured is caught up with.

    A training that was begun without a curve has passed steps whose checkpoints may be kept.
    """
    gauge, run = training.gauge, training.folder.path
    if gauge is None or not training.team.leads:
        return frozenset()
    begin_curve(run, first)
    steps = curve_steps(training.folder.config.schedule.steps)
    points = {point.step: point for point in read_curve(run, first) or ()}
    passed = [step for step in sorted(steps) if step <= first and step not in points]
    for step in passed:
        with suppress(CheckpointError):  # not kept, or damaged
            actor = load_trained(run / FOLDER / f"{STEM.format(step)}.json", training.device)
            points[step] = gauge.measure(actor, actor.info.seconds)
    if points.keys() & set(passed):
        write_curve(run, [points[step] for step in sorted(points)])
    lost = [str(step) for step in passed if step not in points]
    if lost:
        training.say(
            f"curve: no point at step {', '.join(lost)}: passed before a curve was asked for, and "
            "no whole checkpoint of it is kept"
        )
    return steps


@torch.no_grad()
def _measure(training: Training, learner: Learner, step: int, seconds: float) -> None:
    """Add a point to the curve: the actor as the checkpoint of this step would hold it."""
    folder, method, gauge = training.folder, training.method, training.gauge
    assert gauge is not None
    mode = method.training
    method.eval()
    state = method.actor_state(training.supports, window_at(folder.config, step))
    info = checkpoint_info(folder, learner, step, seconds)
    actor = TrainedActor(method, state, training.supports, folder.config, info, folder.path)
    add_point(folder.path, gauge.measure(actor, seconds))
    method.train(mode)


def _picture(training: Training, actors: dict[bytes, KnownActor], window: float, step: int) -> None:
    """Write the strip of the training's first sample."""
    drawn = training.source[0]
    sample = training.on_device(drawn)
    known = known_actor(actors, training.method, drawn, sample.supports)
    picture = snapshot(training.method, sample, known, window, training.folder.config.render)
    folder = training.folder.path / SNAPSHOTS
    folder.mkdir(exist_ok=True)
    write_png(folder / f"step_{step:06d}.png", picture)
