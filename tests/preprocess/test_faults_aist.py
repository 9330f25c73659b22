"""An AIST++ download with something wrong in it: what the user reads.

What these tests record goes into `benchmarks/results/faults.md`; see `scripts/fault_table.py`.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.check import check_sequence
from actorsnerf_preprocess.__main__ import main

FRAMES = 8
WIDTH, HEIGHT = 128, 96


@dataclass(frozen=True)
class Fault:
    """One way to be broken and what is said about it."""

    name: str
    sentence: str
    damage: Callable[[Any], object]
    body: bool = True
    masks: bool = True
    """Given; else they are made."""


def without_videos(stage: Any) -> None:
    for camera in stage.tree.names:
        stage.video(camera).unlink()


def cut_videos(stage: Any) -> None:
    for camera in stage.tree.names:
        stage.cut(stage.video(camera))


def ignored(stage: Any) -> None:
    stage.ignore_list.write_text(f"{stage.tree.name} \n\n")


def black_videos(stage: Any) -> None:
    for camera in stage.tree.names:
        stage.write_video(camera, [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * FRAMES)


def frozen_video(stage: Any) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    stage.write_video("c02", [noise] * FRAMES)


def swapped_videos(stage: Any) -> None:
    spare = stage.source / "spare.mp4"
    stage.video("c01").rename(spare)
    stage.video("c02").rename(stage.video("c01"))
    spare.rename(stage.video("c02"))
    first, second = stage.mask("c01", 0).parent, stage.mask("c02", 0).parent
    first.rename(stage.tree.masks / "spare")
    second.rename(first)
    (stage.tree.masks / "spare").rename(second)


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
        lambda stage: stage.mapping.write_text("gWA_sFM_cAll_d25_mWA2_ch03 setting7_1\n"),
    ),
    Fault(
        "mapping is damaged",
        "mapping.txt, line 1: 1 columns where a sequence and its camera",
        lambda stage: stage.mapping.write_text(f"{stage.tree.name}\n"),
    ),
    Fault(
        "camera file is truncated",
        "setting7_1.json: cannot be read as json",
        lambda stage: stage.cut(stage.setting),
    ),
    Fault(
        "camera file is missing",
        "setting7_1.json: there is no such camera setting",
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
        lambda stage: stage.hostile(stage.motion),
    ),
    Fault("motion is truncated", "not a readable pickle", lambda stage: stage.cut(stage.motion)),
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
            lambda m: m.update(
                smpl_scaling=np.ones(1), smpl_trans=m["smpl_trans"] / m["smpl_scaling"]
            )
        ),
    ),
    Fault("sequence on the ignore list", "or pass --accept-ignored", ignored),
    Fault(
        "all videos black, made masks",
        r"none of the 24 pictures asked for is usable: 24 x empty stage where the body projects "
        r"\(.*\): is this the video of this sequence and camera",
        black_videos,
        masks=False,
    ),
    Fault("all videos truncated", "no view is usable. .* it is cut off", cut_videos),
)

REPORTED = (
    Fault(
        "a truncated video",
        "error: c02: .*OpenCV cannot open this video; it is cut off .* The view is left out",
        lambda stage: stage.cut(stage.video("c02")),
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


def command(stage: Any, fault: Fault) -> list[str]:
    parts = ["prepare", "--source", stage.source, "--out", stage.out, "--all-pairs"]
    parts += ["--workers", "1", *(("--masks", stage.tree.masks) if fault.masks else ())]
    parts += ["--body-model", stage.body] if fault.body else []
    return [str(part) for part in parts]


@pytest.mark.parametrize("fault", REFUSED, ids=named)
def test_refused(
    fault: Fault,
    stage: Any,
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
    stage: Any,
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
        found = check_sequence(stage.out / f"{stage.tree.name}.h5", stage.body)
        assert [one for one in found if one.severity == "error"] == []
    record_property("fault", f"AIST++: {fault.name}")
    record_property("reads", line.strip().replace(f"{stage.home}/", ""))
    record_property("outcome", "counted" if "not stored" in line else "reported")
