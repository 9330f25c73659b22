import dataclasses
import pickle
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
import pytest
import torch
import trimesh

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.states import Counts, Rendering
from actorsnerf_train.animate import AnimateOptions, animate, run_render, shots_of, surface_depth
from actorsnerf_train.judge import Judgement, judge
from actorsnerf_train.pictures import read_png
from actorsnerf_train.trained import TrainedActor, load_trained


class People(Protocol):
    ann: Path
    eve: Path


@pytest.fixture
def trained(fewshot_run: Path) -> TrainedActor[ActorsNeRFState]:
    return load_trained(fewshot_run, torch.device("cpu"))


@pytest.fixture
def options(fewshot_run: Path, tmp_path: Path) -> AnimateOptions:
    return AnimateOptions(fewshot_run, tmp_path / "film", pictures=2, size=32, samples=8)


@pytest.fixture
def aist_file(tmp_path: Path, rng: np.random.Generator) -> Path:
    path = tmp_path / "dance.pkl"
    motion = {
        "smpl_poses": rng.normal(size=(9, 72)) * 0.2,
        "smpl_scaling": np.array([93.0]),
        "smpl_trans": np.zeros((9, 3)),
    }
    path.write_bytes(pickle.dumps(motion))
    return path


def test_a_turntable_needs_no_data_and_leaves_pictures_and_video(options: AnimateOptions) -> None:
    written = run_render(dataclasses.replace(options, alpha=True, depth=True))
    names = ["alpha_0000.png", "alpha_0001.png", "depth_0000.png", "depth_0001.png"]
    names += ["rgb_0000.png", "rgb_0001.png", "video.mp4"]
    assert sorted(path.name for path in written) == names
    assert sorted(path.name for path in options.out.iterdir()) == names
    assert read_png(options.out / "rgb_0000.png").shape == (32, 32, 3)
    video = cv2.VideoCapture(str(options.out / "video.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 2
    depth = cv2.imread(str(options.out / "depth_0000.png"), cv2.IMREAD_UNCHANGED)
    assert depth is not None and depth.dtype == np.uint16


def test_a_shorter_rendering_leaves_no_picture_of_a_longer_one(
    options: AnimateOptions, capsys: pytest.CaptureFixture[str]
) -> None:
    options = dataclasses.replace(options, video=False)
    run_render(dataclasses.replace(options, pictures=4, alpha=True))
    own = ("rgb_0007.png", "rgb_1.png", "alpha_0001.jpg", "notes.txt", "depth_0000.png")
    for name in own:  # of the user
        (options.out / name).write_text("mine")
    capsys.readouterr()
    run_render(options)
    left = sorted(path.name for path in options.out.iterdir())
    assert left == sorted([*own, "rgb_0000.png", "rgb_0001.png"])
    said = "removed: 6 pictures of an earlier rendering, rgb_0002.png to alpha_0003.png"
    assert said in capsys.readouterr().out
    run_render(options)
    assert "removed" not in capsys.readouterr().out


def test_pictures_of_the_users_stay_whatever_their_names(options: AnimateOptions) -> None:
    options = dataclasses.replace(options, pictures=1, video=False)
    options.out.mkdir()
    names = ["alpha_0000.png", "depth_0000.png", "rgb_0001.png", "rgb_0002.png"]
    for name in names:
        cv2.imwrite(str(options.out / name), np.full((4, 4), 7, np.uint8))
    run_render(options)
    left = sorted(path.name for path in options.out.iterdir())
    assert left == sorted([*names, "rgb_0000.png"])


def test_the_t_pose_is_straight(
    trained: TrainedActor[ActorsNeRFState], options: AnimateOptions
) -> None:
    turned = shots_of(trained, options)
    straight = shots_of(trained, dataclasses.replace(options, motion="t-pose"))
    assert len(straight) == len(turned) == 2
    assert not straight[0].pose.any()
    assert np.allclose(turned[0].pose, trained.supports[0].pose.numpy())
    assert np.allclose(straight[0].rest_joints, trained.supports[0].canonical_joints.numpy())


def test_a_novel_view_is_what_evaluation_sees(
    trained: TrainedActor[ActorsNeRFState], options: AnimateOptions, people: People
) -> None:
    view = dataclasses.replace(
        options, motion="view", data=people.eve, camera="camera1", first=6, pictures=1, video=False
    )
    written = animate(trained, view)
    assert [path.name for path in written] == ["rgb_0000.png"]
    render = dataclasses.replace(trained.config.render, samples=8)
    with SequenceFile(people.eve) as file:
        judged = judge(trained, file, (1, 6), Judgement(("strict",), render, None))
    expected = (judged.prediction.clamp(0, 1) * 255).round().numpy().astype(np.uint8)
    assert np.array_equal(read_png(written[0]), expected)


def test_another_sequences_motion_in_its_camera(
    trained: TrainedActor[ActorsNeRFState], options: AnimateOptions, people: People
) -> None:
    foreign = dataclasses.replace(
        options, motion="sequence", data=people.ann, first=3, step=4, pictures=9
    )
    shots = shots_of(trained, foreign)
    with SequenceFile(people.ann) as file:
        poses = file.header.fits.body_pose[[3, 7, 11, 15, 19]]
    assert np.array_equal(np.stack([shot.pose[1:] for shot in shots]), poses)
    assert shots[0].camera.size == (80, 80)
    assert np.allclose(shots[0].rest_joints, trained.supports[0].canonical_joints.numpy())


def test_a_pose_file_is_danced(options: AnimateOptions, aist_file: Path) -> None:
    dance = dataclasses.replace(
        options, motion="pose-file", pose_file=aist_file, step=4, pictures=9, video=False
    )
    assert len(run_render(dance)) == 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"motion": "view"}, "--motion view needs --data FILE.h5, a prepared sequence"),
        ({"motion": "sequence"}, "--motion sequence needs --data FILE.h5"),
        ({"motion": "pose-file"}, "--motion pose-file needs --pose-file FILE.pkl or FILE.npz"),
        ({"mesh": Path("body.stl")}, r"body\.stl: a mesh is written as \.ply or \.obj"),
        ({"motion": "pose-file", "pose_file": Path("a.npz")}, "a.npz: no such pose file"),
    ],
)
def test_what_is_missing_is_named(
    options: AnimateOptions, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(UserError, match=message):
        run_render(dataclasses.replace(options, **changes))  # type: ignore[arg-type]  # any field
    assert not options.out.exists()


def test_another_actors_views_are_refused(options: AnimateOptions, people: People) -> None:
    view = dataclasses.replace(options, motion="view", data=people.ann)
    with pytest.raises(UserError, match="for another's motion take --motion sequence"):
        run_render(view)


def test_a_camera_that_is_not_there(options: AnimateOptions, people: People) -> None:
    view = dataclasses.replace(options, motion="view", data=people.eve, camera="c09")
    with pytest.raises(UserError, match=r"has no camera 'c09'; it has camera0, camera1"):
        run_render(view)


def test_the_mesh_of_the_first_pose(options: AnimateOptions, tmp_path: Path) -> None:
    mesh = tmp_path / "eve.ply"
    coarse = dataclasses.replace(
        options, pictures=1, video=False, mesh=mesh, mesh_resolution=0.1, mesh_level=0.5
    )
    assert run_render(coarse)[-1] == mesh
    assert len(trimesh.load_mesh(mesh).faces) > 10


def test_depth_counts_only_where_light_is_stopped() -> None:
    alpha = torch.tensor([[0.0, 0.4, 0.5, 1.0]])
    depth = torch.tensor([[0.0, 1.2, 1.5, 3.0]])  # 3 m times alpha
    seen = Rendering(torch.zeros(1, 4, 3), alpha, depth, Counts(4, 4, 4, 4))
    assert surface_depth(seen).tolist() == [[0.0, 0.0, 3.0, 3.0]]
