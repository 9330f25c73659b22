import dataclasses
import json
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest
import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_train import evaluate as evaluation_module
from actorsnerf_train.evaluate import EvaluateOptions, evaluate, plan_evaluation, run_evaluate
from actorsnerf_train.judge import Judgement, judge, strip_row
from actorsnerf_train.lpips import LpipsFiles
from actorsnerf_train.pictures import read_png
from actorsnerf_train.result_file import read_result
from actorsnerf_train.trained import TrainedActor, load_trained

CPU = torch.device("cpu")


class People(Protocol):
    ann: Path
    eve: Path


@pytest.fixture(autouse=True)
def without_lpips(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine where the weights were never installed."""

    def nothing(files: LpipsFiles) -> None:
        return None

    monkeypatch.setattr(evaluation_module, "load_lpips", nothing)


def test_pictures_are_compared_where_the_network_is(monkeypatch: pytest.MonkeyPatch) -> None:
    class Anywhere(torch.nn.Module):
        def forward(self, prediction: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
            return (prediction - target).sum()[None]

    monkeypatch.setattr(evaluation_module, "load_lpips", lambda _: Anywhere())
    lpips = evaluation_module.published_lpips(LpipsFiles(), torch.device("meta"))
    assert lpips is not None
    assert lpips(torch.zeros(4, 4, 3), torch.ones(4, 4, 3)).device.type == "meta"


@pytest.fixture
def trained(fewshot_run: Path) -> TrainedActor[ActorsNeRFState]:
    return load_trained(fewshot_run, torch.device("cpu"))


@pytest.fixture
def options(fewshot_run: Path, people: People, tmp_path: Path) -> EvaluateOptions:
    return EvaluateOptions(fewshot_run, people.eve, tmp_path / "evaluation", samples=8)


def test_a_run_leaves_result_table_and_strip(options: EvaluateOptions) -> None:
    found = run_evaluate(dataclasses.replace(options, max_frames=2, strip=1))
    assert sorted(p.name for p in options.out.iterdir()) == [
        "result.json",
        "result.md",
        "strip.png",
    ]
    assert read_result(options.out) == found
    assert found.actor == "eve" and found.method == "actorsnerf"
    assert (found.setting, found.list_name, found.shots, found.supports) == (
        "fewshot-5",
        "official",
        5,
        3,
    )
    assert found.limited and len(found.frames) == 2 and found.cameras == ("camera1",)
    assert found.render_options["samples"] == 8
    assert found.encoder == "resnet18" and not found.encoder_pretrained
    assert found.lpips_note is not None and "no LPIPS weights" in found.lpips_note
    assert {row.convention for row in found.per_image} == {"paper", "strict", "box"}
    sheet = read_png(options.out / "strip.png")
    layout = found.strip
    assert layout is not None and layout.columns == ("truth", "prediction", "error")
    (row,) = layout.rows
    assert (row.camera, row.frame) == ("camera1", found.frames[0])
    across, down = layout.cell
    assert sheet.shape[:2] == (down, 3 * across + 2 * layout.gap)
    second = sheet[: row.height, across + layout.gap :][:, : row.width]
    with SequenceFile(options.data) as file:
        place = (1, file.frame_index(row.frame))
        trained = load_trained(options.checkpoint, CPU)
        render = dataclasses.replace(trained.config.render, samples=8)
        judged = judge(trained, file, place, Judgement((), render, None))
        assert np.array_equal(second, strip_row(file, place, judged)[1])
    assert found.curve is None


def test_means_are_means_of_the_pictures(
    options: EvaluateOptions, trained: TrainedActor[ActorsNeRFState]
) -> None:
    with SequenceFile(options.data) as file:
        found, rows = evaluate(trained, file, dataclasses.replace(options, max_frames=3, strip=2))
    assert len(rows) == 2 and len(found.per_image) == 9
    for mean in found.means:
        own = [row for row in found.per_image if row.convention == mean.convention]
        assert mean.psnr == pytest.approx(np.mean([row.psnr for row in own]))
        assert mean.ssim == pytest.approx(np.mean([row.ssim for row in own]))
        assert mean.lpips_x1000 is None
    (camera,) = {row.camera for row in found.per_camera}
    assert camera == "camera1"
    assert found.mean("paper").psnr == found.mean("strict").psnr
    assert found.mean("paper").ssim > found.mean("strict").ssim
    assert found.render_seconds * 3 < found.seconds


def test_the_plan_is_the_protocols_own(
    options: EvaluateOptions, trained: TrainedActor[ActorsNeRFState]
) -> None:
    file = SequenceFile(options.data)
    (protocol,) = file.header.protocols
    plan = plan_evaluation(trained, file, options)
    assert plan.frames == protocol.evaluation_frames
    assert plan.cameras == protocol.evaluation_cameras
    assert not plan.limited and not plan.missing
    assert len(plan.pairs) == len(plan.frames) * len(plan.cameras)


def test_missing_pictures_are_counted_not_hidden(
    options: EvaluateOptions, trained: TrainedActor[ActorsNeRFState]
) -> None:
    file = SequenceFile(options.data)
    number = file.header.protocols[0].evaluation_frames[0]
    valid = file.valid.copy()
    valid[1, file.frame_index(number)] = False
    file.__dict__["valid"] = valid  # as the reader keeps it
    plan = plan_evaluation(trained, file, options)
    assert plan.missing == (("camera1", number),)
    assert not plan.limited
    assert (1, file.frame_index(number)) not in plan.pairs


def test_a_quick_look_spreads_its_frames(
    options: EvaluateOptions, trained: TrainedActor[ActorsNeRFState]
) -> None:
    file = SequenceFile(options.data)
    whole = file.header.protocols[0].evaluation_frames
    plan = plan_evaluation(trained, file, dataclasses.replace(options, max_frames=3))
    assert plan.frames == (whole[0], whole[round((len(whole) - 1) / 2)], whole[-1])
    one = plan_evaluation(trained, file, dataclasses.replace(options, max_frames=1))
    assert one.frames == whole[:1] and one.limited


def test_another_actors_file_is_refused(options: EvaluateOptions, people: People) -> None:
    message = r"ann\.h5: shows actor ann, but .* was fitted to eve: evaluate on that actor's file"
    with pytest.raises(UserError, match=message):
        run_evaluate(dataclasses.replace(options, data=people.ann))
    assert not options.out.exists()


def test_an_unknown_protocol_is_refused(options: EvaluateOptions) -> None:
    with pytest.raises(UserError, match=r"has no protocol 'actorsnerf-zju'; it has generic"):
        run_evaluate(dataclasses.replace(options, protocol="actorsnerf-zju"))


def test_nothing_to_evaluate_is_refused(options: EvaluateOptions) -> None:
    with pytest.raises(UserError, match="--max-frames is 0, expected at least 1"):
        run_evaluate(dataclasses.replace(options, max_frames=0))


def test_the_same_evaluation_twice_gives_the_same_numbers(options: EvaluateOptions) -> None:
    quick = dataclasses.replace(options, max_frames=1, strip=0)
    first, second = run_evaluate(quick), run_evaluate(quick)
    assert first.means == second.means
    assert not (options.out / "strip.png").exists() and first.strip is None
    assert json.loads((options.out / "result.json").read_text())["schema_version"] == 2


def test_a_device_that_is_not_there(options: EvaluateOptions) -> None:
    with pytest.raises(UserError, match="--device gpu: cannot be used here"):
        run_evaluate(dataclasses.replace(options, device="gpu"))


def test_no_convention_is_a_sentence(options: EvaluateOptions) -> None:
    with pytest.raises(UserError, match="No convention is left to evaluate under"):
        run_evaluate(dataclasses.replace(options, conventions=()))


class Mean(torch.nn.Module):
    """A distance in LPIPS's form: batches of pictures in [-1, 1]."""

    def forward(self, prediction: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
        assert prediction.shape[1] == 3 and prediction.dtype == torch.float32
        return (prediction - target).abs().mean(dim=(1, 2, 3))


def test_lpips_is_asked_for_pictures_in_minus_one_to_one(
    options: EvaluateOptions,
    trained: TrainedActor[ActorsNeRFState],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def loaded(files: LpipsFiles) -> Mean:
        return Mean()

    monkeypatch.setattr(evaluation_module, "load_lpips", loaded)
    with SequenceFile(options.data) as file:
        found, _ = evaluate(trained, file, dataclasses.replace(options, max_frames=1))
        place = (1, file.frame_index(found.frames[0]))
        render = dataclasses.replace(trained.config.render, samples=8)
        judged = judge(trained, file, place, Judgement(("paper",), render, None))
    difference = float((judged.truth - judged.prediction).abs().mean())
    assert found.mean("paper").lpips_x1000 == pytest.approx(2000 * difference, rel=1e-5)
    assert found.lpips_note is None


def test_an_operating_point_is_drawn_and_recorded(options: EvaluateOptions) -> None:
    quick = dataclasses.replace(options, max_frames=1, strip=0, samples=None)
    exact = run_evaluate(dataclasses.replace(quick, point="exact"))
    half = run_evaluate(dataclasses.replace(quick, point="half-samples"))
    assert exact.render_options["samples"] == 12 and half.render_options["samples"] == 6
    assert exact.render_options["stop_transmittance"] == 1e-3
    assert (exact.point, half.point) == ("exact", "half-samples")
    own = run_evaluate(dataclasses.replace(quick, point="exact", stop_transmittance=0.0))
    assert own.render_options["stop_transmittance"] == 0.0
