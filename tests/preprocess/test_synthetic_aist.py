import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.body_model import pose
from actorsnerf_datasets.pickles import load_pickle
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_preprocess.free_body import free_body
from actorsnerf_preprocess.source import OpenOptions
from actorsnerf_preprocess.sources import find_sources, held_out_names, open_source
from actorsnerf_preprocess.stage import SyntheticOptions
from actorsnerf_preprocess.synthetic_aist import write_aist_tree

TRAINED, HELD_OUT = "gBR_sFM_cAll_d31_mBR0_ch01", "gHO_sFM_cAll_d62_mHO0_ch02"
FRAMES = 6


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("aist")
    options = SyntheticOptions(
        actors=1, held_out=1, frames=FRAMES, cameras=2, size=144, texture=128
    )
    write_aist_tree(root, options)
    return root


def video(path: Path) -> list[UInt8]:
    capture, frames = cv2.VideoCapture(str(path)), []
    assert capture.get(cv2.CAP_PROP_FPS) == 60
    while (read := capture.read())[0]:
        frames.append(np.asarray(read[1], np.uint8))
    return frames


def vertices_cm(tree: Path, sequence: str, frame: int) -> Float64:
    """By the data set's own formula: s (R (x - j0) + j0) + t."""
    motion = load_pickle(tree / "annotations" / "motions" / f"{sequence}.pkl")
    assert isinstance(motion, dict)
    poses = motion["smpl_poses"][frame].reshape(24, 3)
    rotation = matrix_from_axis_angle(poses[0])
    body = pose(free_body(), np.zeros(10), np.concatenate([np.zeros((1, 3)), poses[1:]]))
    j0 = body.rest_joints[0]
    turned = (body.vertices - j0) @ rotation.T + j0
    return np.asarray(motion["smpl_scaling"] * turned + motion["smpl_trans"][frame], np.float64)


@pytest.mark.parametrize("sequence", [TRAINED, HELD_OUT])
@pytest.mark.parametrize("camera", [0, 1])
def test_a_posed_body_reprojected_lies_inside_its_true_mask(
    tree: Path, sequence: str, camera: int
) -> None:
    entry = json.loads((tree / "annotations/cameras/setting1.json").read_text())[camera]
    for frame in (0, FRAMES - 1):
        pixels, _ = cv2.projectPoints(
            vertices_cm(tree, sequence, frame),
            np.array(entry["rotation"]),
            np.array(entry["translation"]),
            np.array(entry["matrix"]),
            np.array(entry["distortions"]),
        )
        name = sequence.replace("cAll", entry["name"])
        path = tree / "truth" / "masks" / name / f"{frame:06d}.png"
        mask = cv2.dilate(cv2.imread(str(path), 0), np.ones((3, 3), np.uint8))
        columns, rows = np.rint(pixels[:, 0]).astype(int).T
        assert (mask[rows, columns] > 0).mean() > 0.98
        assert (mask[rows, columns + 8] > 0).mean() < 0.8


def test_videos_show_a_still_noisy_hall_and_a_shadow(tree: Path) -> None:
    frames = video(tree / "videos" / f"{TRAINED.replace('cAll', 'c01')}.mp4")
    assert len(frames) == FRAMES and frames[0].shape == (144, 256, 3)
    masks = tree / "truth" / "masks" / TRAINED.replace("cAll", "c01")
    assert len(list(masks.iterdir())) == FRAMES
    wall = np.stack([frame[:20] for frame in frames]).astype(float)
    assert np.abs(np.diff(wall, axis=0)).mean() < 8
    mask = cv2.imread(str(masks / "000000.png"), 0)
    person_rows = np.nonzero(mask.any(axis=1))[0]
    floor = frames[0][person_rows.max() - 4].astype(float).mean(axis=-1)
    floor[cv2.dilate(mask, np.ones((5, 5), np.uint8))[person_rows.max() - 4] > 0] = np.nan
    assert np.nanmin(floor) < 0.8 * np.nanmedian(floor)


def test_annotations_have_the_real_form(tree: Path) -> None:
    cameras = json.loads((tree / "annotations/cameras/setting1.json").read_text())
    assert [camera["name"] for camera in cameras] == [f"c{number:02d}" for number in range(1, 10)]
    assert all(camera["size"] == [256, 144] for camera in cameras)
    centres = [
        -cv2.Rodrigues(np.array(camera["rotation"]))[0].T @ np.array(camera["translation"])
        for camera in cameras
    ]
    np.testing.assert_allclose(centres[0], [0, 160, 500], atol=1e-6)
    # The second camera stands 45 degrees on, on the side of negative x; the ninth like the first.
    np.testing.assert_allclose(centres[1][[0, 2]], [-353.55, 353.55], atol=0.01)
    assert abs(centres[8][0]) < 1e-6 and centres[8][2] > 400
    for camera in cameras:
        K = np.array(camera["matrix"])
        assert K[0, 0] == K[1, 1] and K[0, 2] == 128 and K[1, 2] == 72
        assert camera["distortions"][1:] == [0, 0, 0, 0]
    mapping = (tree / "annotations/cameras/mapping.txt").read_text()
    assert mapping == f"{TRAINED} setting1\n{HELD_OUT} setting1\n"
    ignored = (tree / "annotations/ignore_list.txt").read_text()
    assert ignored.split("\n")[0].endswith(" ") and ignored.endswith("\n\n")
    assert (tree / "annotations/splits/pose_train.txt").read_text() == TRAINED
    motion = load_pickle(tree / "annotations/motions" / f"{TRAINED}.pkl")
    assert isinstance(motion, dict)
    assert motion["smpl_poses"].shape == (FRAMES, 72) and motion["smpl_scaling"].shape == (1,)
    assert 85 < motion["smpl_scaling"][0] < 105


def test_the_preparation_finds_and_opens_the_tree(tree: Path) -> None:
    found = find_sources(tree)
    assert [(each.name, each.dataset) for each in found] == [
        (TRAINED, "synthetic"),
        (HELD_OUT, "synthetic"),
    ]
    names = held_out_names(tree, ())
    assert names == (HELD_OUT,)
    source = open_source(found[1], OpenOptions(held_out=names))
    assert source.protocols[0].role == "held_out" and source.body_model == "cc0 body"
    assert not [finding for finding in source.findings if finding.severity == "error"]
