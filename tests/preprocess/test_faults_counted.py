"""A ZJU-MoCap download with something wrong in it: the rest is prepared, and the report says so.

What these tests record goes into `benchmarks/results/faults.md`; see `scripts/fault_table.py`.
"""

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.check import check_sequence
from actorsnerf_preprocess.__main__ import main

PAIRS = 12


@dataclass(frozen=True)
class Fault:
    """One way to be broken, what is said about it, and how many pictures it costs."""

    name: str
    sentence: str
    """Of one line of the report."""
    damage: Callable[[Any], object]
    lost: int = 0


def mask_elsewhere(scene: Any) -> None:
    mask = np.zeros((160, 160), np.uint8)
    mask[:, :12] = 1
    cv2.imwrite(str(scene.mask(0, 1)), mask)


def swapped_calibrations(scene: Any) -> None:
    def swap(content: dict[str, Any]) -> None:
        for key in ("K", "R", "T"):
            content["cams"][key] = list(content["cams"][key])[::-1]

    scene.edit_annotations(swap)


def short_poses(scene: Any) -> None:
    for frame in range(4):
        scene.edit_fit(frame, lambda fit: fit.update(poses=fit["poses"][:, 3:]))


def backslashes(scene: Any) -> None:
    def change(content: dict[str, Any]) -> None:
        for frame in content["ims"]:
            frame["ims"] = [name.replace("/", "\\") for name in frame["ims"]]

    scene.edit_annotations(change)


def no_vertices(scene: Any) -> None:
    for folder in ("vertices", "new_vertices"):
        shutil.rmtree(scene.tree / folder)


FAULTS = (
    Fault(
        "picture is truncated",
        "not stored: 1 x truncated, .*B1/000001.jpg",
        lambda scene: scene.cut(scene.picture(0, 1)),
        lost=1,
    ),
    Fault(
        "picture is garbage",
        "not stored: 1 x not a readable picture, .*B1/000001.jpg",
        lambda scene: scene.picture(0, 1).write_bytes(bytes(500)),
        lost=1,
    ),
    Fault(
        "picture is an empty file",
        "not stored: 1 x truncated, .*B1/000001.jpg",
        lambda scene: scene.picture(0, 1).write_bytes(b""),
        lost=1,
    ),
    Fault(
        "picture is missing",
        "not stored: 1 x missing, .*B2/000002.jpg",
        lambda scene: scene.picture(1, 2).unlink(),
        lost=1,
    ),
    Fault(
        "picture cannot be read",
        r"not stored: 1 x cannot be read \(Is a directory\), .*B2/000002.jpg",
        lambda scene: scene.in_place_of_a_file(scene.picture(1, 2)),
        lost=1,
    ),
    Fault(
        "picture of another size",
        "not stored: 1 x 160 x 80 instead of 160 x 160, .*B2/000002.jpg",
        lambda scene: scene.fill(scene.picture(1, 2), 90, (160, 80)),
        lost=1,
    ),
    Fault(
        "mask is empty",
        "not stored: 1 x empty mask, .*B1/000001.jpg",
        lambda scene: scene.fill(scene.mask(0, 1), 0),
        lost=1,
    ),
    Fault(
        "mask is full",
        "not stored: 1 x full mask, .*B1/000001.jpg",
        lambda scene: scene.fill(scene.mask(0, 1), 255),
        lost=1,
    ),
    Fault(
        "mask is missing",
        "not stored: 1 x no mask, .*B1/000001.jpg",
        lambda scene: scene.mask(0, 1).unlink(),
        lost=1,
    ),
    Fault(
        "mask is truncated",
        "not stored: 1 x truncated, .*B1/000001.png",
        lambda scene: scene.cut(scene.mask(0, 1)),
        lost=1,
    ),
    Fault(
        "mask of another shape",
        "not stored: 1 x mask of 160 x 80 for a picture of 160 x 160, .*B1/000001.png",
        lambda scene: scene.fill(scene.mask(0, 1), 255, (160, 80)),
        lost=1,
    ),
    Fault(
        "mask of something else",
        "not stored: 1 x mask elsewhere, .*B1/000001.jpg",
        mask_elsewhere,
        lost=1,
    ),
    Fault(
        "calibrations of two cameras swapped",
        "Camera_B1: only .* % of the projected body lies inside the mask: is this camera cal",
        swapped_calibrations,
    ),
    Fault(
        "fit is missing",
        r"new_params: 1 frames have no fit and are left out \(first: \[2\]\)",
        lambda scene: scene.fit(2).unlink(),
        lost=3,
    ),
    Fault(
        "NaN in a fit",
        "1 fits are unusable and left out; the first: .*2.npy: entry 'poses' is not finite",
        lambda scene: scene.edit_fit(2, lambda fit: fit.update(poses=fit["poses"] * np.nan)),
        lost=3,
    ),
    Fault(
        "pose of 70 numbers",
        "left out; the first: .*2.npy: entry 'poses' has 70 numbers, expected 72 or 69",
        lambda scene: scene.edit_fit(2, lambda fit: fit.update(poses=fit["poses"][:, :70])),
        lost=3,
    ),
    Fault(
        "fit without translation",
        "left out; the first: .*2.npy: has no entry 'Th'",
        lambda scene: scene.edit_fit(2, lambda fit: fit.pop("Th")),
        lost=3,
    ),
    Fault(
        "fit is a hostile pickle",
        "left out; the first: .*2.npy: refused, because its pickle names posix.mkdir",
        lambda scene: scene.hostile(scene.fit(2)),
        lost=3,
    ),
    Fault(
        "fit is truncated",
        "left out; the first: .*2.npy: not a readable pickle",
        lambda scene: scene.cut(scene.fit(2)),
        lost=3,
    ),
    Fault(
        "vertices are truncated",
        r"new_vertices: 1 frames have no readable vertices \(first: \[2\]\)",
        lambda scene: scene.cut(scene.vertices(2)),
    ),
    Fault("no vertices", "new_vertices/ is missing: fits are new_params, unverified", no_vertices),
    Fault(
        "poses of 69 numbers", "Poses of 69 numbers were given a zero root rotation", short_poses
    ),
    Fault(
        "camera translations in metres",
        "Camera translations are metres already",
        lambda scene: scene.edit_camera("T", lambda T, _: T / 1000),
    ),
    Fault(
        "picture lists without names",
        "annots.npy/ims: Holds no picture paths",
        lambda scene: scene.edit_annotations(lambda content: content.update(ims=[])),
    ),
    Fault(
        "backslashes in picture lists",
        "Backslashes in the picture paths of annots.npy were read as slashes",
        backslashes,
    ),
)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name.replace(" ", "-"))
def test_counted_and_reported(
    fault: Fault,
    scene: Any,
    capsys: pytest.CaptureFixture[str],
    record_property: Callable[[str, object], None],
) -> None:
    fault.damage(scene)
    command = ["prepare", "--source", scene.source, "--out", scene.out, "--all-pairs"]
    command += ["--workers", "1", "--body-model", scene.body]
    assert main([str(part) for part in command]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    line = next(line for line in captured.out.splitlines() if re.search(fault.sentence, line))
    assert f"{PAIRS - fault.lost} of " in captured.out
    assert not scene.marker.exists()
    names = {path.name for path in scene.out.iterdir()}
    assert names == {f"CoreView_377.{kind}" for kind in ("h5", "json", "png")}
    if fault.name != "calibrations of two cameras swapped":
        found = check_sequence(scene.out / "CoreView_377.h5", scene.body)
        assert [one for one in found if one.severity == "error"] == []
    record_property("fault", fault.name)
    record_property("reads", line.strip().replace(f"{scene.home}/", ""))
    record_property("outcome", "counted" if fault.lost else "reported")
