import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.body_model import pose, rest
from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.pickles import load_pickle
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_preprocess.aist import find_aist, open_aist
from actorsnerf_preprocess.free_body import free_body, free_body_path
from actorsnerf_preprocess.masks import mask_scores
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import OpenOptions, RawPicture
from actorsnerf_preprocess.stage import SyntheticOptions
from actorsnerf_preprocess.synthetic_aist import write_aist_tree

TINY = SyntheticOptions(actors=1, held_out=1, frames=10, cameras=2, size=180, texture=64)
TRAINED, UNSEEN = "gBR_sFM_cAll_d31_mBR0_ch01", "gHO_sFM_cAll_d62_mHO0_ch02"


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("synthetic") / "aist"
    write_aist_tree(root, TINY)
    return root


def motion_of(tree: Path, sequence: str) -> dict[str, Float64]:
    content = load_pickle(tree / "annotations" / "motions" / f"{sequence}.pkl")
    assert isinstance(content, dict)
    return {key: np.asarray(value, np.float64) for key, value in content.items()}


def entries(tree: Path) -> list[dict[str, list[float]]]:
    content = json.loads((tree / "annotations" / "cameras" / "setting1.json").read_text())
    assert isinstance(content, list)
    return content


def truth(tree: Path, video: str, frame: int) -> UInt8:
    mask = cv2.imread(str(tree / "truth" / "masks" / video / f"{frame:06d}.png"), -1)
    assert mask is not None
    return np.asarray(mask, np.uint8)


def test_a_prepared_tree_passes_its_check(tree: Path, tmp_path: Path) -> None:
    found = {each.name: each for each in find_aist(tree)}
    assert set(found) == {TRAINED, UNSEEN}
    source = open_aist(found[UNSEEN], OpenOptions(held_out=(UNSEEN,)))
    report = prepare_sequence(source, tmp_path, PrepareOptions(scale=1.0, contact_sheet=False))
    assert report is not None
    assert report.stored == report.asked > 0
    findings = check_sequence(tmp_path / f"{UNSEEN}.h5", free_body_path())
    assert [each.sentence for each in findings if each.severity != "note"] == []
    with SequenceFile(tmp_path / f"{UNSEEN}.h5") as prepared:
        header = prepared.header
        assert header.provenance.dataset == "synthetic"
        assert [protocol.role for protocol in header.protocols] == ["held_out"]
        assert not header.shape.betas.any()


def test_the_formula_of_the_data_set_gives_the_body_in_the_picture(tree: Path) -> None:
    """`V = s (R (X - j0) + j0) + t` in centimetres, seen by the cameras as they are listed."""
    motion, model = motion_of(tree, TRAINED), free_body()
    frame, scaling = 5, float(motion["smpl_scaling"].reshape(()))
    angles = motion["smpl_poses"][frame].reshape(24, 3)
    pelvis = rest(model, np.zeros(10))[0][0]
    bent = pose(model, np.zeros(10), np.concatenate([np.zeros((1, 3)), angles[1:]])).vertices
    turned = (bent - pelvis) @ matrix_from_axis_angle(angles[0]).T + pelvis
    world = scaling * turned + motion["smpl_trans"][frame]
    assert abs(world[:, 1].min()) < 5  # feet on the floor, centimetres, y up
    for camera, video in ((0, "gBR_sFM_c01_d31_mBR0_ch01"), (1, "gBR_sFM_c02_d31_mBR0_ch01")):
        entry = {
            key: np.array(value) for key, value in entries(tree)[camera].items() if key != "name"
        }
        pixels, _ = cv2.projectPoints(
            world, entry["rotation"], entry["translation"], entry["matrix"], entry["distortions"]
        )
        columns, rows = np.rint(pixels[:, 0]).astype(int).T
        person = truth(tree, video, frame)
        grown = cv2.dilate(person, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
        assert grown[rows, columns].astype(bool).mean() > 0.98
        # Clothes and hair reach a little further than the body.
        covered = len(np.unique(np.stack([rows, columns]), axis=1).T)
        assert 0.5 < covered / (person > 0).sum() < 1.05


def test_cameras_are_those_of_the_real_calibration(tree: Path) -> None:
    names = [str(entry["name"]) for entry in entries(tree)]
    assert names == [f"c{number:02d}" for number in range(1, 10)]
    for number, entry in enumerate(entries(tree)[:8]):
        K, k = np.array(entry["matrix"]), np.array(entry["distortions"])
        width, height = entry["size"]
        assert (width, height) == (320, 180)
        assert K[0, 0] == K[1, 1]
        np.testing.assert_array_equal(K[:2, 2], [width / 2, height / 2])
        assert k[0] != 0
        assert not k[1:].any()
        R = matrix_from_axis_angle(np.array(entry["rotation"]))
        x, y, z = -R.T @ np.array(entry["translation"])
        # The k-th camera stands at (-500 sin 45 k, 180, 500 cos 45 k) centimetres.
        np.testing.assert_allclose(
            [x, z],
            [-500 * np.sin(np.pi / 4 * number), 500 * np.cos(np.pi / 4 * number)],
            atol=1e-6,
        )
        assert 140 < y < 220
    ninth = entries(tree)[8]
    R = matrix_from_axis_angle(np.array(ninth["rotation"]))
    np.testing.assert_allclose((-R.T @ np.array(ninth["translation"]))[0], 0, atol=1e-6)


def test_motions_have_the_released_shapes(tree: Path) -> None:
    motion = motion_of(tree, UNSEEN)
    assert motion["smpl_poses"].shape == (10, 72)
    assert motion["smpl_trans"].shape == (10, 3)
    assert 80 < float(motion["smpl_scaling"].reshape(())) < 115
    assert "smpl_loss" in motion
    assert np.abs(motion["smpl_poses"][:, :3]).max() > 0


def test_lists_have_the_quirks_of_the_released_ones(tree: Path) -> None:
    annotations = tree / "annotations"
    lines = (annotations / "ignore_list.txt").read_text().split("\n")
    assert lines[0].endswith(" ")
    assert lines[-2:] == ["", ""]
    mapping = (annotations / "cameras" / "mapping.txt").read_text()
    assert f"{TRAINED} setting1\n" in mapping
    train = (annotations / "splits" / "pose_train.txt").read_text()
    assert train == TRAINED
    assert (tree / "held_out.txt").read_text() == f"{UNSEEN}\n"
    assert json.loads((tree / "synthetic.json").read_text())["format"] == "AIST++"


def test_videos_have_sixty_noisy_pictures_a_second_before_a_static_hall(tree: Path) -> None:
    video = cv2.VideoCapture(str(tree / "videos" / "gBR_sFM_c01_d31_mBR0_ch01.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(60)
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 10
    pictures = np.stack([video.read()[1] for _ in range(10)]).astype(float)
    video.release()
    top = pictures[:, :20]
    assert 0.3 < top.std(axis=0).mean() < 5  # noise that the codec leaves
    assert top.mean(axis=0).std() > 4  # texture that stays


def test_the_person_throws_a_soft_shadow(tree: Path) -> None:
    """Beside the person the floor is darker than it is without one."""
    video = cv2.VideoCapture(str(tree / "videos" / "gBR_sFM_c01_d31_mBR0_ch01.mp4"))
    picture = np.asarray(video.read()[1], np.float64)
    video.release()
    person = truth(tree, "gBR_sFM_c01_d31_mBR0_ch01", 0)
    near = cv2.dilate(person, np.ones((9, 9), np.uint8)).astype(bool)
    rows, columns = np.nonzero(person)
    lowest = slice(int(rows.max()) - 6, int(rows.max()) + 6)
    level = picture[lowest].mean(axis=2)
    away = np.ones(level.shape[1], bool)
    away[max(columns.min() - 60, 0) : columns.max() + 60] = False
    beside = near[lowest] & (person[lowest] == 0)
    assert level[beside].mean() < level[:, away].mean() - 5


def test_made_masks_find_the_true_person(tree: Path) -> None:
    found = next(each for each in find_aist(tree) if each.name == TRAINED)
    source = open_aist(found, OpenOptions())
    picture = next(iter(source.reader.read_many(0, [6])))
    assert isinstance(picture, RawPicture)
    assert picture.mask is not None
    overlap, _ = mask_scores(picture.mask, truth(tree, "gBR_sFM_c01_d31_mBR0_ch01", 6))
    assert overlap > 0.8


def test_noisy_fits_keep_the_true_ones_beside(tmp_path: Path) -> None:
    options = replace(TINY, actors=0, frames=3, cameras=1, size=64, fit_noise=True)
    write_aist_tree(tmp_path, options)
    name = "gHO_sFM_cAll_d61_mHO0_ch01.pkl"
    found = load_pickle(tmp_path / "annotations" / "motions" / name)
    exact = load_pickle(tmp_path / "truth" / "motions" / name)
    assert isinstance(found, dict)
    assert isinstance(exact, dict)
    off = np.abs(np.asarray(found["smpl_trans"]) - np.asarray(exact["smpl_trans"]))
    assert 0 < off.max() < 10  # centimetres
    np.testing.assert_array_equal(found["smpl_scaling"], exact["smpl_scaling"])
