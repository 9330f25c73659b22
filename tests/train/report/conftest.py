from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import pytest
import torch

from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.neuralbody import NeuralBodyState
from actorsnerf_train.machine import Machine
from actorsnerf_train.report import measure as measuring
from actorsnerf_train.report.frames import Frame, Health, report_frames
from actorsnerf_train.report.measure import Contestant, Effort, Measured, Spread, measure
from actorsnerf_train.report.points import PointName, at_point, named_point
from actorsnerf_train.report.rows import (
    ActorReport,
    LearningRow,
    PartRow,
    PointRow,
    ScalingRow,
    SpeedReport,
    TrainingRow,
)
from actorsnerf_train.trained import TrainedActor, load_trained


class People(Protocol):
    folder: Path
    ann: Path
    eve: Path


NAMES: tuple[PointName, ...] = ("reference", "complete", "exact", "half-samples", "bfloat16")


@pytest.fixture(autouse=True, scope="session")
def in_one_turn() -> Iterator[None]:
    """Nobody draws again only to be timed better."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(measuring, "BRIEF", 0.0)
        patched.setattr(measuring, "TURNS", 1)
        yield


@pytest.fixture(scope="session")
def trained(fewshot_run: Path) -> TrainedActor[ActorsNeRFState]:
    """Six steps of training, made dense enough to be seen and to stop rays."""
    actor = load_trained(fewshot_run, torch.device("cpu"))
    with torch.no_grad():
        actor.method.radiance.density_out.weight.mul_(30)  # type: ignore[attr-defined]  # ActorsNeRF
        actor.method.radiance.density_out.bias.add_(6)  # type: ignore[attr-defined]  # ActorsNeRF
    return actor


@pytest.fixture(scope="session")
def neuralbody(neuralbody_run: Path) -> TrainedActor[NeuralBodyState]:
    """The same of Neural Body, as it was trained."""
    return load_trained(neuralbody_run, torch.device("cpu"))


@pytest.fixture(scope="session")
def frames(trained: TrainedActor[ActorsNeRFState], people: People) -> tuple[Frame, ...]:
    with SequenceFile(people.eve) as file:
        return report_frames(trained, file, 2, 1)


@pytest.fixture(scope="session")
def effort() -> Effort:
    return Effort(rounds=2, share=1.0, seed=0)


@pytest.fixture(scope="session")
def contestants(trained: TrainedActor[ActorsNeRFState]) -> list[Contestant]:
    points = [named_point(name) for name in NAMES]
    return [Contestant(p.name, p.says, p.kind, p.precision, at_point(trained, p)) for p in points]


@pytest.fixture(scope="session")
def measured(
    contestants: list[Contestant], frames: tuple[Frame, ...], effort: Effort
) -> tuple[Measured, ...]:
    return measure(contestants, frames, effort)


def _point(name: str, seconds: float, decibel: float, worse: str | None) -> PointRow:
    return PointRow(
        name=name,
        says=f"what {name} does",
        kind="reference" if name == "reference" else "exact" if decibel > 80 else "stated",
        precision="float32",
        samples_per_ray=128,
        threshold=0.01,
        stop_transmittance=0.0,
        seconds=seconds,
        seconds_low=0.9 * seconds,
        seconds_high=1.1 * seconds,
        faster=100.0 / seconds,
        rays=1000.0,
        samples=128_000.0,
        survivors=6400.0,
        painted=900.0,
        density_flops=1.4e6,
        colour_flops=1.0e6,
        of_limit=0.7,
        memory_mb=None if name == "fast" else 123.4,
        psnr=None if name == "reference" else 25.0,
        ssim=None if name == "reference" else 0.9,
        lpips_x1000=None,
        reference_psnr=decibel,
        reference_mean=0.001,
        reference_largest=0.0 if decibel > 80 else 0.05,
        largest_anywhere=None if name == "reference" else 0.0 if decibel > 80 else 0.06,
        dominated_by=worse,
    )


@pytest.fixture(scope="session")
def report() -> SpeedReport:
    """A report with numbers from nowhere, one of every kind of row."""
    spread = Spread(1.0, 0.9, 1.2)
    actor = ActorReport(
        actor="eve",
        checkpoint="run/step.json",
        data="eve.h5",
        data_sha256="0" * 64,
        method="ActorsNeRF",
        preset="tiny",
        step=7,
        samples_per_ray=8,
        size=(80, 60),
        body_share=0.125,
        frames=("camera1, frame 4",),
        reference_pixels=77,
        health=Health(0.97, 24.5),
        points=(
            _point("reference", 100.0, 100.0, "exact"),
            _point("exact", 2.0, 90.0, None),
            _point("fast", 0.5, 42.0, None),
        ),
        recommended="fast",
        scaling=(ScalingRow("picture", "160x120", 0.25, 1001, 4321),),
        training=(TrainingRow("pretrain", 4, 32, 128, spread, spread, 7.5, 1e-6, 2e-5, "a.b"),),
        learning=(LearningRow(20.0, 100, 60.0, 450.0), LearningRow(21.5, 150, 90.0, None)),
        parts=(
            PartRow("nothing", spread, 1.4e6, 1e6, 640),
            PartRow("deformation", spread, 1e6, 1e6, 640),
        ),
    )
    return SpeedReport(
        commit="abc",
        machine=Machine("cpu", "a processor", 2, 1, "2.13", "Linux"),
        seed=0,
        rounds=5,
        reference_share=0.05,
        gemm={"float32": 1e11},
        lpips_note=None,
        time="2026-01-01T00:00:00+00:00",
        seconds=9.0,
        actors=(actor,),
    )
