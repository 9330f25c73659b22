"""An AIST++ download with something wrong in it: what the user reads.

What these tests record goes into `benchmarks/results/faults.md`; see `scripts/fault_table.py`.
"""

import json
import os
import pickle
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.body_model import load_body_model, pose
from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.conventions import world_from_body
from actorsnerf_preprocess.__main__ import main

NAME = "gBR_sBM_cAll_d04_mBR0_ch09"
CAMERAS = ("c01", "c02", "c03")
FRAMES = 8
WIDTH, HEIGHT = 128, 96
SCALING = 95.0


class Hostile:
    """Its pickle makes a folder when it is loaded without care."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str]]:
        return os.mkdir, (str(self.marker),)


@dataclass(frozen=True)
class Stage:
    """A sound AIST++ tree in a folder of its own, to be damaged."""

    home: Path

    @property
    def source(self) -> Path:
        return self.home / "aist"

    @property
    def out(self) -> Path:
        return self.home / "out"

    @property
    def body(self) -> Path:
        return next(self.home.glob("tiny_*.npz"), self.home / "tiny_male.npz")

    @property
    def masks(self) -> Path:
        return self.home / "masks"

    @property
    def marker(self) -> Path:
        return self.home / "executed"

    @property
    def motion(self) -> Path:
        return self.source / "motions" / f"{NAME}.pkl"

    @property
    def mapping(self) -> Path:
        return self.source / "cameras" / "mapping.txt"

    @property
    def setting(self) -> Path:
        return self.source / "cameras" / "setting1.json"

    def video(self, camera: str) -> Path:
        return self.source / "videos" / f"{NAME.replace('cAll', camera)}.mp4"

    def mask(self, camera: str, frame: int) -> Path:
        return self.masks / NAME / camera / f"{frame:06d}.png"

    def edit_motion(self, change: Callable[[dict[str, Any]], object]) -> None:
        content = pickle.loads(self.motion.read_bytes())
        change(content)
        self.motion.write_bytes(pickle.dumps(content))

    def edit_camera(self, change: Callable[[dict[str, Any]], object]) -> None:
        """Changes the second camera."""
        content = json.loads(self.setting.read_text())
        change(content[1])
        self.setting.write_text(json.dumps(content))

    def write_video(self, camera: str, pictures: list[Any]) -> None:
        height, width = pictures[0].shape[:2]
        path = self.video(camera)
        path.parent.mkdir(exist_ok=True)
        code = cv2.VideoWriter.fourcc(*"mp4v")
        writer = cv2.VideoWriter(str(path), code, 60.0, (width, height))
        for picture in pictures:
            writer.write(picture)
        writer.release()


@pytest.fixture
def stage(tmp_path: Path, tiny_body: Path) -> Stage:
    """Three cameras, eight frames, a grey stage with a coloured dancer, and given masks."""
    rng = np.random.default_rng(4)
    made = Stage(tmp_path)
    made.body.write_bytes(tiny_body.read_bytes())
    model = load_body_model(made.body)
    poses = np.cumsum(rng.normal(0, 0.02, (FRAMES, 24, 3)), axis=0)
    turn = np.linspace(0, 2 * np.pi, FRAMES, endpoint=False)
    transl = np.stack([0.8 * np.sin(turn), np.full(FRAMES, 1.2), 0.8 * np.cos(turn)], axis=1)
    vertices = []
    for axis_angles, moved in zip(poses, transl, strict=True):
        body = np.concatenate([np.zeros((1, 3)), axis_angles[1:]])
        posed = pose(model, np.zeros(10), body)
        matrix = world_from_body(axis_angles[0], moved, posed.rest_joints[0])
        vertices.append(posed.vertices @ matrix[:3, :3].T + matrix[:3, 3])
    made.motion.parent.mkdir(parents=True)
    motion = {
        "smpl_poses": poses.reshape(FRAMES, 72),
        "smpl_scaling": np.array([SCALING]),
        "smpl_trans": SCALING * transl,
    }
    made.motion.write_bytes(pickle.dumps(motion))
    made.mapping.parent.mkdir()
    made.mapping.write_text(f"{NAME} setting1\n")
    cameras = [_camera(index) for index in range(len(CAMERAS))]
    made.setting.write_text(json.dumps(cameras))
    for camera in cameras:
        pictures = [_drawn(made, camera, frame, world) for frame, world in enumerate(vertices)]
        made.write_video(camera["name"], pictures)
    return made


def _camera(index: int) -> dict[str, Any]:
    turn = 2 * np.pi * index / len(CAMERAS)
    centre = np.array([4.0 * np.sin(turn), 1.3, 4.0 * np.cos(turn)])
    forward = np.array([0.0, 0.95, 0.0]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    return {
        "name": CAMERAS[index],
        "size": [WIDTH, HEIGHT],
        "matrix": [[150.0, 0, WIDTH / 2], [0, 150.0, HEIGHT / 2], [0, 0, 1]],
        "rotation": cv2.Rodrigues(R)[0].ravel().tolist(),
        "translation": (-R @ centre * SCALING).tolist(),
        "distortions": [-0.05, 0, 0, 0, 0],
    }


def _drawn(made: Stage, camera: dict[str, Any], frame: int, world: Any) -> Any:
    """The picture; its mask is written beside."""
    K, lens = np.array(camera["matrix"]), np.array(camera["distortions"])
    position = np.array(camera["translation"]) / SCALING
    pixels, _ = cv2.projectPoints(world, np.array(camera["rotation"]), position, K, lens)
    picture = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for box in pixels.reshape(24, 8, 2):
        hull = cv2.convexHull(np.round(box).astype(np.int32))
        cv2.fillConvexPoly(picture, hull, (40, 60, 220))
        cv2.fillConvexPoly(mask, hull, 255)
    path = made.mask(camera["name"], frame)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), mask)
    return picture


@dataclass(frozen=True)
class Fault:
    """One way to be broken and what is said about it."""

    name: str
    sentence: str
    damage: Callable[[Stage], object]
    body: bool = True
    masks: bool = True
    """Given; else they are made."""


def cut(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def without_videos(stage: Stage) -> None:
    for camera in CAMERAS:
        stage.video(camera).unlink()


def cut_videos(stage: Stage) -> None:
    for camera in CAMERAS:
        cut(stage.video(camera))


def ignored(stage: Stage) -> None:
    (stage.source / "ignore_list.txt").write_text(f"{NAME} \n\n")


def frozen_video(stage: Stage) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    stage.write_video("c02", [noise] * FRAMES)


def swapped_videos(stage: Stage) -> None:
    spare = stage.source / "spare.mp4"
    stage.video("c01").rename(spare)
    stage.video("c02").rename(stage.video("c01"))
    spare.rename(stage.video("c02"))
    first, second = stage.mask("c01", 0).parent, stage.mask("c02", 0).parent
    first.rename(stage.masks / "spare")
    second.rename(first)
    (stage.masks / "spare").rename(second)


REFUSED = (
    Fault(
        "no videos",
        "1 motions but none of their videos; accept the terms at",
        without_videos,
    ),
    Fault(
        "no camera settings",
        "there is no cameras/mapping.txt below it",
        lambda stage: stage.mapping.unlink(),
    ),
    Fault("no male body model", "fitted with SMPL's male model", lambda _: None, body=False),
    Fault(
        "sequence is not in the mapping",
        "mapping.txt: names no camera setting for gBR",
        lambda stage: stage.mapping.write_text("gWA_sFM_cAll_d25_mWA2_ch03 setting1\n"),
    ),
    Fault(
        "mapping is damaged",
        "mapping.txt, line 1: 1 columns where a sequence and its camera",
        lambda stage: stage.mapping.write_text(f"{NAME}\n"),
    ),
    Fault(
        "camera file is truncated",
        "setting1.json: cannot be read as json",
        lambda stage: cut(stage.setting),
    ),
    Fault(
        "camera file is missing",
        "setting1.json: there is no such camera setting",
        lambda stage: stage.setting.unlink(),
    ),
    Fault(
        "camera without an entry",
        "camera c02: has no entry rotation",
        lambda stage: stage.edit_camera(lambda camera: camera.pop("rotation")),
    ),
    Fault(
        "camera of another picture",
        "camera c02, matrix: focal lengths .* do not belong to a 128 x 96 picture",
        lambda stage: stage.edit_camera(lambda camera: camera["matrix"][0].__setitem__(2, 960.0)),
    ),
    Fault(
        "motion is a hostile pickle",
        "refused, because its pickle names posix.mkdir",
        lambda stage: stage.motion.write_bytes(pickle.dumps(Hostile(stage.marker))),
    ),
    Fault("motion is truncated", "not a readable pickle", lambda stage: cut(stage.motion)),
    Fault(
        "NaN in the motion",
        "smpl_poses: 576 of 576 numbers are not finite",
        lambda stage: stage.edit_motion(lambda m: m.update(smpl_poses=m["smpl_poses"] * np.nan)),
    ),
    Fault(
        "motion without scaling",
        "has no entry smpl_scaling",
        lambda stage: stage.edit_motion(lambda motion: motion.pop("smpl_scaling")),
    ),
    Fault(
        "motion of 69 numbers",
        r"smpl_poses: shape \(8, 69\), expected",
        lambda stage: stage.edit_motion(lambda m: m.update(smpl_poses=m["smpl_poses"][:, 3:])),
    ),
    Fault(
        "motion in metres",
        "the cameras would stand .* m from the dancer, 1 to 15 m is plausible: motion and cameras",
        lambda stage: stage.edit_motion(
            lambda m: m.update(smpl_scaling=np.ones(1), smpl_trans=m["smpl_trans"] / SCALING)
        ),
    ),
    Fault("sequence on the ignore list", "or pass --accept-ignored", ignored),
    Fault("all videos truncated", "no view is usable. .* it is cut off", cut_videos),
)

REPORTED = (
    Fault(
        "a truncated video",
        "error: c02: .*OpenCV cannot open this video; it is cut off .* The view is left out",
        lambda stage: cut(stage.video("c02")),
    ),
    Fault(
        "a missing video",
        "warning: c02: there is no video of this view; it is left out",
        lambda stage: stage.video("c02").unlink(),
    ),
    Fault(
        "a video of another shape",
        "is 96 x 96, but 128 x 96 was calibrated, another shape; the view is left out",
        lambda stage: stage.write_video("c02", [np.zeros((96, 96, 3), np.uint8)] * FRAMES),
    ),
    Fault(
        "a video that ends early",
        r"covers 5 instants .*the motion has 8; the shorter is used",
        lambda stage: stage.write_video("c02", [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 5),
    ),
    Fault(
        "a female body model",
        "is not SMPL's male model by its name",
        lambda stage: stage.body.rename(stage.home / "tiny_female.npz"),
    ),
    Fault(
        "videos of two cameras swapped",
        "c0.: only .* % of the projected body lies inside the mask",
        swapped_videos,
    ),
    Fault(
        "videos of two cameras swapped, made masks",
        "not stored: .* x empty stage where the body projects, .*_c01_",
        swapped_videos,
        masks=False,
    ),
    Fault(
        "a black video, made masks",
        "not stored: 8 x empty stage where the body projects, .*_c02_",
        lambda stage: stage.write_video("c02", [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * FRAMES),
        masks=False,
    ),
    Fault(
        "a frozen video, made masks",
        "not stored: 8 x empty stage where the body projects, .*_c02_",
        frozen_video,
        masks=False,
    ),
    Fault(
        "an empty mask",
        "not stored: 1 x empty mask",
        lambda stage: cv2.imwrite(str(stage.mask("c01", 3)), np.zeros((96, 128), np.uint8)),
    ),
    Fault(
        "a mask of another size",
        "not stored: 1 x mask of 64 x 48 instead of 128 x 96",
        lambda stage: cv2.imwrite(str(stage.mask("c01", 3)), np.full((48, 64), 255, np.uint8)),
    ),
    Fault(
        "a missing mask",
        "not stored: 1 x no mask",
        lambda stage: stage.mask("c01", 3).unlink(),
    ),
    Fault(
        "a mask that is no picture",
        "not stored: 1 x not a readable picture",
        lambda stage: stage.mask("c01", 3).write_bytes(b"mask"),
    ),
)


def named(fault: Fault) -> str:
    return fault.name.replace(" ", "-")


def command(stage: Stage, fault: Fault) -> list[str]:
    parts = ["prepare", "--source", stage.source, "--out", stage.out, "--all-pairs"]
    parts += ["--workers", "1", *(("--masks", stage.masks) if fault.masks else ())]
    parts += ["--body-model", stage.body] if fault.body else []
    return [str(part) for part in parts]


@pytest.mark.parametrize("fault", REFUSED, ids=named)
def test_refused(
    fault: Fault,
    stage: Stage,
    capsys: pytest.CaptureFixture[str],
    record_property: Callable[[str, object], None],
) -> None:
    fault.damage(stage)
    assert main(command(stage, fault)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.match(f"error: .*{fault.sentence}", line), line
    assert not list(stage.out.glob("*"))
    assert not stage.marker.exists()
    record_property("fault", f"AIST++: {fault.name}")
    record_property("reads", line.replace(f"{stage.home}/", ""))
    record_property("outcome", "refused")


@pytest.mark.parametrize("fault", REPORTED, ids=named)
def test_counted_and_reported(
    fault: Fault,
    stage: Stage,
    capsys: pytest.CaptureFixture[str],
    record_property: Callable[[str, object], None],
) -> None:
    fault.damage(stage)
    assert main(command(stage, fault)) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    lines = captured.out.splitlines()
    line = next((line for line in lines if re.search(fault.sentence, line)), None)
    assert line is not None, captured.out
    assert {path.suffix for path in stage.out.iterdir()} == {".h5", ".json", ".png"}
    if "swapped" not in fault.name:
        found = check_sequence(stage.out / f"{NAME}.h5", stage.body)
        assert [one for one in found if one.severity == "error"] == []
    record_property("fault", f"AIST++: {fault.name}")
    record_property("reads", line.strip().replace(f"{stage.home}/", ""))
    record_property("outcome", "counted" if "not stored" in line else "reported")
