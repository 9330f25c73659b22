"""A ZJU-MoCap download or a command that cannot be right: one sentence, and nothing is written.

Each case damages a sound tree in one way and runs the command line. `scripts/fault_table.py` makes
`benchmarks/results/faults.md` of what the tests record.
"""

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from actorsnerf_preprocess.__main__ import main

FRAMES = range(4)


@dataclass(frozen=True)
class Fault:
    """One way to be broken and what is said about it."""

    name: str
    sentence: str
    """Searched for in what the user reads."""
    damage: Callable[[Any], object]
    extra: tuple[str, ...] = ()
    """Of the command; `{home}` stands for the scene's folder."""
    body: bool = True


def nothing(_: Any) -> None:
    pass


def next_to_aist(scene: Any) -> None:
    for folder in ("motions", "cameras"):
        (scene.source / folder).mkdir()
    (scene.source / "motions" / "gBR_sBM_cAll_d04_mBR0_ch01.pkl").write_bytes(b"")
    (scene.source / "cameras" / "mapping.txt").write_text("")
    (scene.source / "gBR_sBM_c01_d04_mBR0_ch01.mp4").write_bytes(b"")


def two_of_one_name(scene: Any) -> None:
    shutil.copytree(scene.tree, scene.source / "again" / scene.tree.name)


def hostile_body(scene: Any) -> None:
    scene.hostile(scene.home / "smpl.pkl")


def larger_body(scene: Any) -> None:
    def change(content: dict[str, Any]) -> None:
        for key in ("v_template", "shapedirs", "posedirs", "weights"):
            content[key] = np.concatenate([content[key], content[key][:1]])
        content["J_regressor"] = np.pad(content["J_regressor"], ((0, 0), (0, 1)))

    scene.edit_body(change)


def smplx_body(scene: Any) -> None:
    scene.edit_body(lambda c: c.update(weights=np.pad(c["weights"], ((0, 0), (0, 31)))))


def short_list(scene: Any) -> None:
    scene.edit_annotations(lambda content: content["ims"][2]["ims"].pop())


def reordered_list(scene: Any) -> None:
    scene.edit_annotations(lambda content: content["ims"][2]["ims"].reverse())


def millimetre_bodies(scene: Any) -> None:
    shutil.rmtree(scene.tree / "params")
    for frame in FRAMES:
        scene.edit_fit(frame, lambda fit: fit.update(Th=fit["Th"] * 1000))


def millimetre_bodies_without_vertices(scene: Any) -> None:
    millimetre_bodies(scene)
    shutil.rmtree(scene.tree / "new_vertices")


def crossed_fits(scene: Any) -> None:
    """The refit's vertices lie in the old folder, and something else in theirs."""
    shutil.rmtree(scene.tree / "params")
    shutil.rmtree(scene.tree / "vertices")
    (scene.tree / "new_vertices").rename(scene.tree / "vertices")
    (scene.tree / "new_vertices").mkdir()
    for frame in FRAMES:
        other = scene.tree / "vertices" / f"{(frame + 1) % len(FRAMES)}.npy"
        scene.vertices(frame).write_bytes(other.read_bytes())


def mixed_fits(scene: Any) -> None:
    for frame in (1, 3):
        old = (scene.tree / "vertices" / f"{frame}.npy").read_bytes()
        scene.vertices(frame).write_bytes(old)


def hostile_fits(scene: Any) -> None:
    for frame in FRAMES:
        scene.hostile(scene.fit(frame))


def no_fits(scene: Any) -> None:
    for folder in ("params", "new_params"):
        shutil.rmtree(scene.tree / folder)


def empty_masks(scene: Any) -> None:
    for path in scene.masks():
        scene.fill(path, 0)


FAULTS = (
    Fault(
        "source folder does not exist",
        r"nowhere: no such folder; --source names the folder of the download",
        nothing,
        ("--source", "{home}/nowhere"),
    ),
    Fault(
        "source is no data set",
        r"raw: is no data set that can be read; looked for ZJU-MoCap \(annots.npy",
        lambda scene: (scene.tree / "annots.npy").unlink(),
    ),
    Fault(
        "two data sets in one folder",
        r"holds ZJU-MoCap \(CoreView_377, ...\) and AIST\+\+ .*: pass the folder of one",
        next_to_aist,
    ),
    Fault("two sequences of one name", "two sequences are called CoreView_377", two_of_one_name),
    Fault(
        "sequence that does not exist",
        "has no sequence '378'; it has CoreView_377",
        nothing,
        ("--sequences", "378"),
    ),
    Fault("no body model", "is given: register at .* with --body-model", nothing, body=False),
    Fault(
        "body model is missing",
        "tiny_neutral.npz: no such body-model file: register at",
        lambda scene: scene.body.unlink(),
    ),
    Fault(
        "body model is a hostile pickle",
        "smpl.pkl: refused, because its pickle names posix.mkdir",
        hostile_body,
        ("--body-model", "{home}/smpl.pkl"),
        body=False,
    ),
    Fault(
        "body model is truncated",
        "not a readable .npz of plain arrays .* is the file complete",
        lambda scene: scene.cut(scene.body),
    ),
    Fault("body model is SMPL-X", "'weights' is float64 .192, 55., expected .* SMPL-X", smplx_body),
    Fault(
        "body model has other vertices than the fits",
        "has 192 vertices, but the body model has 193",
        larger_body,
    ),
    Fault(
        "annotations are a hostile pickle",
        "annots.npy: refused, because its pickle names posix.mkdir",
        lambda scene: scene.hostile(scene.tree / "annots.npy"),
    ),
    Fault(
        "annotations are truncated",
        "annots.npy: not a readable pickle .* is the download complete",
        lambda scene: scene.cut(scene.tree / "annots.npy"),
    ),
    Fault(
        "annotations without cameras",
        "annots.npy: expected a dictionary with 'cams'",
        lambda scene: scene.edit_annotations(lambda content: content.pop("cams")),
    ),
    Fault(
        "NaN in a camera",
        "cams/K of camera index 1 is not finite",
        lambda scene: scene.edit_camera("K", lambda K, index: K * np.nan if index else K),
    ),
    Fault(
        "left-handed rotation",
        "cams/R of camera index 1 is left-handed",
        lambda scene: scene.edit_camera("R", lambda R, index: -R if index == 1 else R),
    ),
    Fault(
        "rotation with a scale in it",
        "cams/R of camera index . is not a rotation",
        lambda scene: scene.edit_camera("R", lambda R, _: R * 1.1),
    ),
    Fault(
        "camera translations in centimetres",
        "neither millimetres .* nor metres .*: are they centimetres",
        lambda scene: scene.edit_camera("T", lambda T, _: T / 10),
    ),
    Fault(
        "camera translations in tens of metres",
        "neither millimetres .* nor metres",
        lambda scene: scene.edit_camera("T", lambda T, _: T / 70),
    ),
    Fault(
        "body translations in millimetres",
        "rebuilt vertices differ from new_vertices by .* mm",
        millimetre_bodies,
    ),
    Fault(
        "body translations in millimetres, no vertices",
        "m from the camera, expected 0.5 to 20.0 m: are T of annots.npy and Th",
        millimetre_bodies_without_vertices,
    ),
    Fault(
        "picture list is too short",
        r"ims\[2\] lists 2 pictures, but 'cams' has 3 cameras",
        short_list,
    ),
    Fault(
        "picture list swaps cameras",
        r"ims\[2\] lists the cameras in another order than ims\[0\]",
        reordered_list,
    ),
    Fault(
        "vertex folders of two fits swapped",
        "they fit vertices: the folders of two fits were mixed",
        crossed_fits,
    ),
    Fault("files of two fits in one folder", "were files of two fits mixed in one", mixed_fits),
    Fault(
        "hostile pickle in every fit",
        "no usable fit for any of 4 frames .*names posix.mkdir",
        hostile_fits,
    ),
    Fault("no fits", "has no folder of SMPL fits", no_fits),
    Fault("empty masks only", "none of the 12 pictures .* 12 x empty mask", empty_masks),
    Fault(
        "no masks",
        "none of the 12 pictures .* 12 x no mask .* or pass --masks",
        lambda scene: shutil.rmtree(scene.tree / "mask_cihp"),
    ),
    Fault(
        "mask folder does not exist", "no such folder of masks", nothing, ("--masks", "{home}/gone")
    ),
    Fault(
        "mask folder of something else",
        "has no mask of this sequence; expected files such as",
        lambda scene: (scene.home / "other").mkdir(),
        ("--masks", "{home}/other"),
    ),
    Fault(
        "output folder is a file",
        "out: cannot be made or used as a folder",
        lambda scene: scene.out.write_text(""),
    ),
    Fault("scale of zero", "--scale 0: expected more than 0", nothing, ("--scale", "0")),
    Fault("no workers", "--workers 0: expected 1 or more", nothing, ("--workers", "0")),
    Fault(
        "held-out actor that is not there",
        "--held-out 378: no such actor or sequence; there are CoreView_377",
        nothing,
        ("--held-out", "378"),
    ),
    Fault(
        "held_out.txt is no text",
        "held_out.txt: cannot be read as text",
        lambda scene: (scene.source / "held_out.txt").write_bytes(b"\xff\xfe"),
    ),
)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name.replace(" ", "-"))
def test_refused(
    fault: Fault,
    scene: Any,
    capsys: pytest.CaptureFixture[str],
    record_property: Callable[[str, object], None],
) -> None:
    fault.damage(scene)
    command = ["prepare", "--source", scene.source, "--out", scene.out, "--all-pairs"]
    command += ["--workers", "1", *(("--body-model", scene.body) if fault.body else ())]
    command += [part.format(home=scene.home) for part in fault.extra]
    assert main([str(part) for part in command]) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert re.match(rf"error: .*{fault.sentence}", line)
    assert not list(scene.out.glob("*"))
    assert not scene.marker.exists()
    record_property("fault", fault.name)
    record_property("reads", line.replace(f"{scene.home}/", ""))
    record_property("outcome", "refused")
