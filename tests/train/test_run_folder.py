import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.checkpoint import DataFile, Origin
from actorsnerf_train.config import TrainConfig
from actorsnerf_train.loop import Training, train
from actorsnerf_train.run_folder import CONFIG, RunFolder, first_difference, package_versions


@pytest.fixture
def folder(tmp_path: Path, config: TrainConfig) -> RunFolder:
    data = (DataFile("a/x.h5", "walk", "ann", "ab"),)
    return RunFolder(tmp_path / "run", config, data, None, Origin(None, False, None, None, ()))


def test_a_new_run_says_what_it_is(folder: RunFolder) -> None:
    assert folder.open(write=True) is None
    record = json.loads((folder.path / CONFIG).read_text())
    assert record["configuration"]["schedule"]["steps"] == 8
    assert record["data"] == [["walk", "ann", "ab"]]
    assert record["program"]["versions"]["torch"] is not None
    assert folder.open(write=True) is None


def test_a_process_that_does_not_lead_writes_nothing(folder: RunFolder) -> None:
    assert folder.open(write=False) is None
    assert not folder.path.exists()


def test_another_run_is_refused(folder: RunFolder) -> None:
    folder.open(write=True)
    other = replace(folder, config=replace(folder.config, seed=5))
    with pytest.raises(UserError, match=r"another run \(configuration/seed is 0 there, 5 here\)"):
        other.open(write=True)
    other = replace(folder, data=(DataFile("a/x.h5", "walk", "ann", "cd"),))
    with pytest.raises(UserError, match="choose another --run"):
        other.open(write=True)


def test_a_run_from_before_a_setting_existed_goes_on(folder: RunFolder) -> None:
    folder.open(write=True)
    record = json.loads((folder.path / CONFIG).read_text())
    assert record["configuration"]["render"].pop("least_weight") == 0.0
    (folder.path / CONFIG).write_text(json.dumps(record))
    assert folder.open(write=True) is None
    record["configuration"]["seed"] = "five"
    (folder.path / CONFIG).write_text(json.dumps(record))
    with pytest.raises(UserError, match=r"configuration.*seed is 'five', expected int"):
        folder.open(write=True)


@pytest.mark.parametrize("content", [b"{bad", b"[1]", b"\xff"])
def test_a_damaged_description_is_one_sentence(folder: RunFolder, content: bytes) -> None:
    folder.open(write=True)
    (folder.path / CONFIG).write_bytes(content)
    with pytest.raises(UserError, match=r"config\.json: .*JSON.*choose another --run"):
        folder.open(write=True)


def test_a_checkpoint_without_its_description_is_no_other_run(
    make_training: Callable[[Path, TrainConfig], Training], config: TrainConfig, tmp_path: Path
) -> None:
    config = replace(config, schedule=replace(config.schedule, steps=1))
    training = make_training(tmp_path, config)
    train(training)
    (tmp_path / CONFIG).unlink()
    other = replace(training.folder, config=replace(config, seed=5))
    with pytest.raises(
        UserError, match=r"step_000001.*another run \(configuration/seed is 0 there"
    ):
        other.open(write=True)
    assert not (tmp_path / CONFIG).exists()
    found = training.folder.open(write=True)
    assert found is not None and found.info.step == 1
    assert (tmp_path / CONFIG).is_file()


def test_moved_data_is_the_same_data(folder: RunFolder) -> None:
    folder.open(write=True)
    replace(folder, data=(DataFile("b/y.h5", "walk", "ann", "ab"),)).open(write=True)


def test_differences_are_found_inside() -> None:
    assert first_difference({"a": {"b": 1}}, {"a": {"b": 1}}, "") is None
    assert first_difference({}, {"a": {"b": 1}}, "") == "a is None there, {'b': 1} here"


def test_packages_that_are_not_installed_have_no_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("actorsnerf_train.run_folder.PACKAGES", ("torch", "no-such-package"))
    versions = package_versions()
    assert versions["no-such-package"] is None
    assert isinstance(versions["torch"], str)
