import dataclasses
from pathlib import Path
from typing import Protocol

import pytest
import torch
from safetensors.torch import load_file

from actorsnerf_datasets.errors import UserError
from actorsnerf_model.baked.actor import BakedState
from actorsnerf_train.__main__ import main
from actorsnerf_train.animate import AnimateOptions, run_render
from actorsnerf_train.bake import BakeCommand, run_bake
from actorsnerf_train.checkpoint import CheckpointError
from actorsnerf_train.evaluate import EvaluateOptions, run_evaluate
from actorsnerf_train.fewshot import FewshotOptions, run_fewshot
from actorsnerf_train.options import Changes, Resources
from actorsnerf_train.result_file import read_result
from actorsnerf_train.trained import load_actor, load_baked, load_trained

CPU = torch.device("cpu")


class People(Protocol):
    ann: Path
    eve: Path


@pytest.fixture(scope="session")
def baked_file(fewshot_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Read it, do not write it."""
    path = tmp_path_factory.mktemp("baked") / "eve.safetensors"
    told = run_bake(BakeCommand(fewshot_run, path, voxel=0.06, offset_spacing=0.1))
    assert told[0].startswith(f"baked: {path} (") and "6 cm voxels" in told[0]
    return path


def test_the_file_knows_whom_it_shows_and_where_it_comes_from(
    baked_file: Path, fewshot_run: Path
) -> None:
    baked, trained = load_baked(baked_file, CPU), load_trained(fewshot_run, CPU)
    assert baked.actor == "eve" and baked.device == CPU and baked.path == baked_file
    assert baked.info == trained.info and baked.config == trained.config
    assert baked.support_count == trained.support_count == 3
    assert baked.baking is not None and baked.baking.options.voxel == 0.06
    assert baked.baking.checkpoint == str(trained.path)
    for ours, theirs in zip(
        dataclasses.astuple(baked.home), dataclasses.astuple(trained.home), strict=True
    ):
        assert torch.equal(ours, theirs)
    assert isinstance(load_actor(baked_file, CPU).state, BakedState)
    assert not isinstance(load_actor(fewshot_run, CPU).state, BakedState)
    assert not isinstance(
        load_actor(trained.path.with_suffix(".safetensors"), CPU).state, BakedState
    )


def test_it_is_baked_in_float32_however_it_was_trained(
    baked_file: Path, bfloat16_run: Path, tmp_path: Path
) -> None:
    path = tmp_path / "eve.safetensors"
    run_bake(BakeCommand(bfloat16_run, path, voxel=0.06, offset_spacing=0.1))
    exact, rough = load_file(baked_file), load_file(path)
    assert exact.keys() == rough.keys()
    for name, one in exact.items():
        assert torch.equal(one, rough[name]), name


def test_render_needs_nothing_but_the_file(baked_file: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone.safetensors"
    alone.write_bytes(baked_file.read_bytes())
    options = AnimateOptions(alone, tmp_path / "film", pictures=2, size=32, video=False)
    assert [path.name for path in run_render(options)] == ["rgb_0000.png", "rgb_0001.png"]
    straight = dataclasses.replace(options, motion="t-pose", pictures=1, depth=True, alpha=True)
    assert len(run_render(straight)) == 3


def test_evaluation_says_that_the_actor_was_baked(
    baked_file: Path, people: People, tmp_path: Path
) -> None:
    options = EvaluateOptions(
        baked_file, people.eve, tmp_path / "e", max_frames=1, max_cameras=1, strip=0
    )
    found = run_evaluate(options)
    written = read_result(tmp_path / "e")
    assert found.method == written.method == "actorsnerf-baked"
    assert written.baked is not None
    about = written.baked["options"]
    assert isinstance(about, dict) and about["voxel"] == 0.06
    assert written.supports == 3 and written.checkpoint == str(baked_file)
    with pytest.raises(
        UserError, match=r"shows actor ann, but .*eve.safetensors was fitted to eve"
    ):
        run_evaluate(dataclasses.replace(options, data=people.ann))


def test_a_method_without_a_baked_form_is_refused(
    people: People, quick: Changes, tmp_path: Path
) -> None:
    run, out = tmp_path / "run", tmp_path / "actor.safetensors"
    change, use = dataclasses.replace(quick, steps=1), Resources(workers=0, check=False)
    run_fewshot(
        FewshotOptions(
            people.eve,
            run,
            "scratch",
            "fewshot-5",
            method="humannerf",
            preset="tiny",
            change=change,
            use=use,
        )
    )
    with pytest.raises(UserError, match="was fitted with humannerf, which has no baked form"):
        run_bake(BakeCommand(run, out))
    assert not out.exists()


def test_a_category_cannot_be_baked(category_run: Path, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="is a category checkpoint, which knows no actor"):
        run_bake(BakeCommand(category_run, tmp_path / "a.safetensors"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"out": Path("actor.pt")}, r"actor.pt: a baked actor is written as \.safetensors"),
        ({"voxel": 1.0}, "--voxel 1: is in metres, from 0.002 to 0.1"),
        ({"offset_spacing": 0.0}, "--offset-spacing 0: is in metres"),
    ],
)
def test_slips_are_named(
    fewshot_run: Path, tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    command = BakeCommand(fewshot_run, tmp_path / "a.safetensors")
    with pytest.raises(UserError, match=message):
        run_bake(dataclasses.replace(command, **changes))  # type: ignore[arg-type]  # any field


def test_the_command_line(
    fewshot_run: Path, category_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "a.safetensors")
    coarse = ["--voxel", "0.1", "--offset-spacing", "0.1"]
    assert main(["bake", "--checkpoint", str(fewshot_run), "--out", out, *coarse]) == 0
    assert f"render --checkpoint {out}" in capsys.readouterr().out
    assert main(["bake", "--checkpoint", str(category_run), "--out", out]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    junk = tmp_path / "junk.safetensors"
    junk.write_bytes(b"no tensors")
    assert main(["render", "--checkpoint", str(junk), "--out", str(tmp_path / "film")]) == 2
    assert "junk.safetensors: is not readable as safetensors" in capsys.readouterr().err
