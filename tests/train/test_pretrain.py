import json
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.checkpoint import load_checkpoint
from actorsnerf_train.options import Changes, Resources
from actorsnerf_train.pretrain import PretrainOptions, run_pretrain


class People(Protocol):
    folder: Path
    ann: Path
    ben: Path
    eve: Path


@pytest.fixture
def options(people: People, quick: Changes, tmp_path: Path) -> PretrainOptions:
    use = Resources(workers=0)
    return PretrainOptions((people.ann,), tmp_path / "run", "tiny", change=quick, use=use)


def test_a_run_folder_tells_everything(category_run: Path) -> None:
    checkpoint = load_checkpoint(category_run)
    info = checkpoint.info
    assert (info.stage, info.step, info.method, info.setting) == ("pretrain", 6, "actorsnerf", None)
    assert [(file.actor, file.sequence) for file in info.data] == [
        ("ann", "ann-walks"),
        ("ben", "ben-walks"),
    ]
    assert all(len(file.digest) == 64 for file in info.data)
    assert (info.origin.trunk, info.origin.trunk_pretrained) == ("resnet18", False)
    assert info.versions["torch"] is not None
    assert checkpoint.part("actor") == {}
    record = json.loads((category_run / "config.json").read_text())
    assert record["configuration"] == info.configuration
    assert (category_run / "log.jsonl").read_text().count("\n") == 1
    assert list((category_run / "tensorboard").iterdir())
    assert (category_run / "pictures" / "step_000006.png").is_file()
    assert sorted(path.stem for path in (category_run / "checkpoints").glob("*.json")) == [
        "step_000003",
        "step_000006",
    ]


def test_a_held_out_actor_is_refused(options: PretrainOptions, people: People) -> None:
    with pytest.raises(UserError, match=r"eve\.h5: actor eve is held out.*would leak the test"):
        run_pretrain(replace(options, data=(people.ann, people.eve)))
    assert not options.run.exists()


def test_a_folder_of_another_run_is_refused(options: PretrainOptions, category_run: Path) -> None:
    with pytest.raises(UserError, match="the folder holds another run"):
        run_pretrain(replace(options, run=category_run))


def test_weights_that_are_not_there_are_refused(options: PretrainOptions, tmp_path: Path) -> None:
    pretrained = replace(options, trunk_weights="imagenet", trunk_file=tmp_path / "r.pth")
    with pytest.raises(UserError, match=r"r\.pth: ImageNet weights of resnet18 were asked for"):
        run_pretrain(pretrained)
    assert not options.run.exists()


def test_weights_that_would_be_left_out_are_refused(
    options: PretrainOptions, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match=r"r\.pth: the encoder would begin from random weights"):
        run_pretrain(replace(options, trunk_file=tmp_path / "r.pth"))
    assert not options.run.exists()


def test_parts_can_be_left_out(options: PretrainOptions) -> None:
    change = replace(options.change, steps=1)
    bare = replace(options, without=("deformation", "body_features"), change=change)
    names = load_checkpoint(run_pretrain(bare)).part("model")
    assert {name.split(".")[0] for name in names} == {"encoder", "skinning", "radiance"}
    record = json.loads((options.run / "config.json").read_text())["configuration"]["model"]
    assert [record[name] for name in ("deformation", "pixel_features", "body_features")] == [
        False,
        True,
        False,
    ]


def test_files_are_checked_first(options: PretrainOptions, tmp_path: Path, people: People) -> None:
    broken = tmp_path / "ann.h5"
    broken.write_bytes(people.ann.read_bytes()[:-4096])
    with pytest.raises(UserError, match=r"ann\.h5"):
        run_pretrain(replace(options, data=(broken,)))
    assert not options.run.exists()
