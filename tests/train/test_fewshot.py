import shutil
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import h5py
import pytest
import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_model.humannerf import HumanNeRFState
from actorsnerf_model.neuralbody import NeuralBody
from actorsnerf_model.presets import HUMANNERF_TINY
from actorsnerf_model.render import render
from actorsnerf_model.weight_file import WeightsError
from actorsnerf_train.batches import camera_of
from actorsnerf_train.checkpoint import CheckpointError, load_checkpoint
from actorsnerf_train.config import MethodName, pretraining
from actorsnerf_train.fewshot import FewshotOptions, run_fewshot
from actorsnerf_train.methods import actorsnerf, build_method
from actorsnerf_train.options import Changes, Resources
from actorsnerf_train.pretrain import begin_trunk
from actorsnerf_train.trained import load_trained


class People(Protocol):
    ann: Path
    eve: Path


@pytest.fixture
def options(people: People, quick: Changes, category_run: Path, tmp_path: Path) -> FewshotOptions:
    use = Resources(workers=0, check=False)
    run = tmp_path / "run"
    return FewshotOptions(people.eve, run, category_run, "fewshot-5", change=quick, use=use)


def test_category_parts_stand_still_and_the_others_move(
    fewshot_run: Path, category_run: Path
) -> None:
    before = load_checkpoint(category_run).part("model")
    after = load_checkpoint(fewshot_run).part("model")
    assert before.keys() == after.keys()
    moved = {name.split(".")[0] for name in before if not torch.equal(before[name], after[name])}
    assert moved == {"deformation", "sparse", "radiance"}


def test_a_fitting_tells_where_it_comes_from(fewshot_run: Path, category_run: Path) -> None:
    info, category = load_checkpoint(fewshot_run).info, load_checkpoint(category_run).info
    assert info.origin.category_digest == category.tensors_sha256
    assert (info.origin.category_step, info.origin.category_data) == (6, category.data)
    assert info.origin.category_seconds == category.seconds > 0
    setting = info.setting
    assert setting is not None
    assert (setting.name, setting.list_name, setting.protocol) == (
        "fewshot-5",
        "official",
        "generic",
    )
    assert (len(setting.frames), len(setting.supports)) == (5, 3)


def test_the_deformation_moves_points_at_the_end(fewshot_run: Path, category_run: Path) -> None:
    """Of both short trainings: it has kicked in, and its last layer has left its start near 0."""
    for run in (fewshot_run, category_run):
        info = load_checkpoint(run)
        bias = info.part("model")["deformation.offset.bias"]
        assert bias.abs().max() > 1e-5, run
    trained = load_trained(fewshot_run, torch.device("cpu"))
    state, deformation = trained.state, trained.method.deformation  # type: ignore[attr-defined]  # ActorsNeRF
    assert state.window > 0
    points = torch.rand(50, 3, generator=torch.Generator().manual_seed(3)) * 2 - 1
    octaves = trained.config.actorsnerf.deformation_net.octaves
    views = trained.config.model.views
    offsets = deformation(points, float(octaves), torch.zeros(24, 3), torch.zeros(views, 50, 256))
    assert offsets.abs().mean() > 1e-5


def test_a_missing_category_checkpoint_is_an_error(options: FewshotOptions, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="no such run folder or checkpoint; pretrain first"):
        run_fewshot(replace(options, category=tmp_path / "nothing"))
    (tmp_path / "begun").mkdir()
    with pytest.raises(CheckpointError, match="holds no checkpoint"):
        run_fewshot(replace(options, category=tmp_path / "begun"))
    assert not options.run.exists()


def test_from_scratch_is_asked_by_name_and_trains_everything(options: FewshotOptions) -> None:
    change = replace(options.change, steps=2)
    scratch = replace(options, category="scratch", preset="tiny", change=change)
    info = load_checkpoint(run_fewshot(scratch)).info
    assert info.origin.category_digest is None
    assert info.configuration["freeze_category"] is False


def test_humannerf_learns_resumes_and_renders_without_its_file(
    options: FewshotOptions, tmp_path: Path
) -> None:
    alone = replace(options, category="scratch", method="humannerf", preset="tiny")
    whole = load_checkpoint(run_fewshot(alone))
    assert (whole.info.method, whole.info.step) == ("humannerf", 6)
    assert {name.split(".")[0] for name in whole.part("model")} == {
        "skinning",
        "refiner",
        "motion",
        "canonical",
    }
    (alone.run / "checkpoints" / "latest").write_text("step_000003\n")  # as if killed after step 3
    for path in (alone.run / "checkpoints").glob("step_000006.*"):
        path.unlink()
    again = load_checkpoint(run_fewshot(alone))
    assert again.info.tensors_sha256 == whole.info.tensors_sha256
    trained = load_trained(alone.run, torch.device("cpu"))
    state = trained.state
    assert isinstance(state, HumanNeRFState)
    assert state.window == HUMANNERF_TINY.motion.octaves if HUMANNERF_TINY.motion else 0
    view = trained.supports[0]
    pose = trained.method.pose_state(state, view.pose, view.rest_joints)
    picture = render(trained.method, state, pose, camera_of(view), trained.config.render)
    assert picture.rgb.isfinite().all()
    assert picture.counts.survivors > 0


def test_neural_body_learns_resumes_and_renders_without_its_file(
    options: FewshotOptions, tmp_path: Path
) -> None:
    alone = replace(options, category="scratch", method="neuralbody", preset="tiny")
    whole = load_checkpoint(run_fewshot(alone))
    assert (whole.info.method, whole.info.step) == ("neuralbody", 6)
    assert {name.split(".")[0] for name in whole.part("model")} == {"codes", "sparse", "radiance"}
    (alone.run / "checkpoints" / "latest").write_text("step_000003\n")  # as if killed after step 3
    for path in (alone.run / "checkpoints").glob("step_000006.*"):
        path.unlink()
    again = load_checkpoint(run_fewshot(alone))
    assert again.info.tensors_sha256 == whole.info.tensors_sha256
    trained = load_trained(alone.run, torch.device("cpu"))
    method, setting = trained.method, whole.info.setting
    assert isinstance(method, NeuralBody)
    assert setting is not None
    # The frames that were drawn have moved away from each other, and an unseen one is in between.
    assert method.config.frames == setting.frames
    assert method.codes.frames.shape == (5, method.config.field.latent)
    assert method.codes.frames.abs().amax(1).gt(1e-4).sum() >= 2
    assert not method.latent(max(setting.frames) + 1).any()
    view = trained.supports[0]
    assert method.config.vertices == len(view.rest_vertices)
    pose = method.pose_state(trained.state, view.pose, view.rest_joints, view.frame)
    picture = render(method, trained.state, pose, camera_of(view), trained.config.render)
    assert picture.rgb.isfinite().all()
    assert picture.counts.survivors > 0


def test_scratch_begins_with_the_trunk_that_the_preset_names(options: FewshotOptions) -> None:
    """The same first encoder as its category training would have had."""
    scratch = replace(options, category="scratch")
    with pytest.raises(WeightsError, match="ImageNet weights of resnet18 were asked for"):
        run_fewshot(replace(scratch, preset="official"))
    method = actorsnerf(build_method(pretraining("small-vgg"), torch.device("cpu")))
    assert method.encoder is not None
    before = method.encoder.trunk.state_dict()
    first = next(iter(before))
    random = before[first].clone()
    origin = begin_trunk(method, None)
    assert origin.trunk_pretrained and origin.trunk == "vgg16"
    assert not torch.equal(method.encoder.trunk.state_dict()[first], random)


@pytest.mark.parametrize("name", ["humannerf", "neuralbody"])
def test_a_baseline_has_no_category(options: FewshotOptions, name: MethodName) -> None:
    with pytest.raises(CheckpointError, match=f"but {name} is asked, which learns one person"):
        run_fewshot(replace(options, method=name))
    assert not options.run.exists()


def test_a_checkpoint_of_another_preset_is_refused(options: FewshotOptions) -> None:
    with pytest.raises(
        CheckpointError, match="trained with the preset tiny, but official is asked"
    ):
        run_fewshot(replace(options, preset="official"))


def test_a_fewshot_checkpoint_is_no_category(options: FewshotOptions, fewshot_run: Path) -> None:
    with pytest.raises(
        CheckpointError, match="is a few-shot checkpoint, expected one of a category"
    ):
        run_fewshot(replace(options, category=fewshot_run))


def test_the_actor_must_be_unseen(options: FewshotOptions, people: People, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="actor ann was in the category training already"):
        run_fewshot(replace(options, data=people.ann))
    renamed = tmp_path / "renamed.h5"
    shutil.copy(people.eve, renamed)
    with h5py.File(renamed, "r+") as file:
        file.attrs["actor"] = "ben"
    with pytest.raises(UserError, match="actor ben was in the category training already"):
        run_fewshot(replace(options, data=renamed))


def test_frames_that_are_not_there(options: FewshotOptions) -> None:
    with pytest.raises(UserError, match="has no setting fewshot-300 for actor eve; it has"):
        run_fewshot(replace(options, protocol="fewshot-300"))
    with pytest.raises(UserError, match="has no protocol 'actorsnerf-zju'; it has generic"):
        run_fewshot(replace(options, study="actorsnerf-zju"))
    assert not options.run.exists()


def test_a_killed_fitting_goes_on_bit_for_bit(options: FewshotOptions, fewshot_run: Path) -> None:
    run_fewshot(options)
    first = options.run / "checkpoints"
    (first / "latest").write_text("step_000003\n")  # as if killed after step 3
    for path in first.glob("step_000006.*"):
        path.unlink()
    resumed = load_checkpoint(run_fewshot(options))
    assert resumed.info.tensors_sha256 == load_checkpoint(fewshot_run).info.tensors_sha256
