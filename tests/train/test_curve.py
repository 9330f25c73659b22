from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest
import torch

from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.torch_dataset import FewshotDataset, Sample
from actorsnerf_model.states import RenderOptions
from actorsnerf_train import curve as curve_module
from actorsnerf_train import evaluate as evaluation_module
from actorsnerf_train import loop as loop_module
from actorsnerf_train.checkpoint import load_checkpoint
from actorsnerf_train.config import MethodName
from actorsnerf_train.curve import CONVENTION, curve_steps, make_gauge
from actorsnerf_train.curve_file import CURVE, read_curve
from actorsnerf_train.evaluate import EvaluateOptions, run_evaluate
from actorsnerf_train.fewshot import FewshotOptions, run_fewshot
from actorsnerf_train.judge import Judged, judge
from actorsnerf_train.lpips import Lpips, LpipsFiles
from actorsnerf_train.options import Changes, Resources

STEPS = (1, 2, 4, 5, 6)
"""Of a fitting of six, where it is measured."""


class People(Protocol):
    eve: Path


class Killed(Exception):
    """Stands for the end of the process."""


@pytest.fixture(scope="module", autouse=True)
def two_pictures_and_no_lpips() -> Iterator[None]:
    """Loading LPIPS draws from torch's generator, as building a network does; there is none."""

    def drawn(files: LpipsFiles) -> Lpips | None:
        torch.rand(3)
        return None

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation_module, "load_lpips", drawn)
        patch.setattr(curve_module, "PICTURES", 2)
        yield


@pytest.fixture(scope="module")
def curved(
    people: People,
    quick: Changes,
    category_run: Path,
    two_pictures_and_no_lpips: None,
    tmp_path_factory: pytest.TempPathFactory,
) -> FewshotOptions:
    """Of a finished run: that of `fewshot_run`, and measured."""
    use, run = Resources(workers=0, check=False), tmp_path_factory.mktemp("curve") / "run"
    options = FewshotOptions(
        people.eve, run, category_run, "fewshot-5", change=quick, use=use, curve=True
    )
    torch.manual_seed(0)  # as `fewshot_run` begins: what it ends with is compared
    run_fewshot(options)
    return options


@pytest.fixture
def alone(curved: FewshotOptions, tmp_path: Path) -> FewshotOptions:
    """A fitting of HumanNeRF of three steps, which is measured after each."""
    return replace(
        curved,
        category="scratch",
        method="humannerf",
        preset="tiny",
        run=tmp_path / "alone",
        change=replace(curved.change, steps=3),
    )


def run_until_killed(options: FewshotOptions, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five steps of a fitting, then the end of the process."""
    whole = FewshotDataset.__getitem__

    def until_killed(self: FewshotDataset, index: int) -> Sample:
        if index == 5:
            raise Killed
        return whole(self, index)

    with monkeypatch.context() as patch:
        patch.setattr(FewshotDataset, "__getitem__", until_killed)
        with pytest.raises(Killed):
            run_fewshot(options)


def test_measuring_changes_nothing_of_the_training(
    curved: FewshotOptions, fewshot_run: Path
) -> None:
    plain, measured = load_checkpoint(fewshot_run).info, load_checkpoint(curved.run).info
    assert measured.tensors_sha256 == plain.tensors_sha256
    assert measured.generator == plain.generator
    assert measured.configuration == plain.configuration
    assert not (fewshot_run / CURVE).exists()
    points = read_curve(curved.run, 99)
    assert points is not None and tuple(point.step for point in points) == STEPS


@pytest.mark.parametrize("method", ["actorsnerf", "humannerf", "neuralbody"])
def test_nor_where_running_statistics_and_pose_refiner_learn(
    alone: FewshotOptions, method: MethodName, tmp_path: Path
) -> None:
    scratch = replace(alone, method=method)
    plain = replace(scratch, run=tmp_path / "plain", curve=False)
    measured, unmeasured = (load_checkpoint(run_fewshot(one)).info for one in (scratch, plain))
    assert measured.tensors_sha256 == unmeasured.tensors_sha256


def test_the_method_rests_while_it_is_measured_and_then_trains_on(
    alone: FewshotOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    measure = loop_module._measure

    def modes(method: torch.nn.Module) -> list[bool]:
        return [module.training for module in method.modules()]

    def watched_measure(training: Any, *rest: Any) -> None:
        before = modes(training.method)
        measure(training, *rest)
        assert before[0] and modes(training.method) == before
        told.append("trains")

    def watched_judge(trained: Any, *rest: Any) -> Judged:
        told.append("moves" if any(modes(trained.method)) else "rests")
        return judge(trained, *rest)

    monkeypatch.setattr(loop_module, "_measure", watched_measure)
    monkeypatch.setattr(curve_module, "judge", watched_judge)
    run_fewshot(alone)
    assert told == ["rests", "rests", "trains"] * 3


def test_a_resumed_run_has_the_curve_of_an_unbroken_one(
    curved: FewshotOptions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = replace(curved, run=tmp_path / "broken")
    run_until_killed(options, monkeypatch)
    # the last checkpoint is of step 3: what was measured after it is to be measured anew
    assert load_checkpoint(options.run).info.step == 3
    before = read_curve(options.run, 99)
    assert before is not None and [point.step for point in before] == [1, 2, 4, 5]
    run_fewshot(replace(options, curve=False))  # a run that has a curve goes on with it
    broken, unbroken = read_curve(options.run, 99), read_curve(curved.run, 99)
    assert broken is not None and unbroken is not None
    assert [replace(p, seconds=0.0) for p in broken] == [replace(p, seconds=0.0) for p in unbroken]
    seconds = [point.seconds for point in broken]
    assert seconds == sorted(seconds)


def test_a_curve_asked_for_late_has_what_the_kept_checkpoints_tell(
    curved: FewshotOptions,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    change = replace(curved.change, checkpoint_every=2)
    options = replace(curved, run=tmp_path / "late", change=change)
    run_until_killed(replace(options, curve=False), monkeypatch)
    assert not (options.run / CURVE).exists()
    run_fewshot(options)
    late, whole = read_curve(options.run, 99), read_curve(curved.run, 99)
    assert late is not None and whole is not None
    # the checkpoints of steps 2 and 4 are kept, that of step 1 never was
    assert [replace(p, seconds=0.0) for p in late] == [replace(p, seconds=0.0) for p in whole[1:]]
    assert [p.seconds for p in late] == sorted(p.seconds for p in late)
    assert (
        "curve: no point at step 1: passed before a curve was asked for" in capsys.readouterr().out
    )


def test_the_last_point_is_what_the_evaluation_finds_on_its_pictures(
    curved: FewshotOptions, tmp_path: Path
) -> None:
    found = run_evaluate(EvaluateOptions(curved.run, curved.data, tmp_path / "evaluation"))
    assert found.curve is not None and tuple(point.step for point in found.curve) == STEPS
    last = found.curve[-1]
    assert len(set(last.pictures)) == 2 and last.lpips_x1000 is None
    rows = [
        row
        for row in found.per_image
        if row.convention == CONVENTION and (row.camera, row.frame) in last.pictures
    ]
    assert len(rows) == 2
    assert last.psnr == pytest.approx(np.mean([row.psnr for row in rows]), rel=1e-6)
    assert last.ssim == pytest.approx(np.mean([row.ssim for row in rows]), rel=1e-6)
    assert 0 < last.seconds <= found.training_seconds
    assert isinstance(curved.category, Path)
    assert found.category_seconds == load_checkpoint(curved.category).info.seconds


def test_an_earlier_checkpoint_has_the_curve_up_to_there(
    curved: FewshotOptions, tmp_path: Path
) -> None:
    early = curved.run / "checkpoints" / "step_000003.json"
    quick = EvaluateOptions(early, curved.data, tmp_path / "evaluation", max_frames=1)
    found = run_evaluate(quick)
    assert found.curve is not None and [point.step for point in found.curve] == [1, 2]


def test_what_measuring_takes_is_no_training_time(
    alone: FewshotOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]

    def slow(*arguments: object) -> None:
        clock[0] += 1000.0

    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    monkeypatch.setattr(loop_module, "_measure", slow)
    assert load_checkpoint(run_fewshot(alone)).info.seconds == 0.0
    assert clock[0] == 3000.0


def test_the_gauge_leaves_the_generator_alone_and_takes_evaluation_pictures(
    people: People,
) -> None:
    torch.manual_seed(5)
    state = torch.get_rng_state()
    gauge = make_gauge(people.eve, "generic", RenderOptions(), LpipsFiles(), torch.device("cpu"))
    assert torch.equal(torch.get_rng_state(), state)
    with SequenceFile(people.eve) as file:
        (protocol,) = file.header.protocols
        numbers = {int(file.header.frames[frame]) for _, frame in gauge.places}
    assert numbers <= set(protocol.evaluation_frames)
    assert gauge.judgement.conventions == ("box",) and gauge.judgement.lpips is None


def test_short_runs_are_measured_after_distinct_steps() -> None:
    assert sorted(curve_steps(6)) == list(STEPS)
    assert sorted(curve_steps(1)) == [1]
    assert sorted(curve_steps(1000)) == [20, 50, 100, 200, 400, 600, 800, 1000]
