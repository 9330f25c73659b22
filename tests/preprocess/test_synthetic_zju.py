import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.body_model import pose, rest
from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.pickles import load_npy
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_preprocess.free_body import free_body, free_body_path
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import OpenOptions, SourceError
from actorsnerf_preprocess.stage import SyntheticOptions
from actorsnerf_preprocess.synthetic_zju import write_zju_tree
from actorsnerf_preprocess.zju import find_zju, open_zju

TINY = SyntheticOptions(actors=1, held_out=1, frames=10, cameras=2, size=128, texture=32)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("synthetic") / "zju"
    write_zju_tree(root, TINY)
    return root


@pytest.fixture(scope="module")
def imperfect(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Names with time stamps, fits that are off, ragged masks."""
    root = tmp_path_factory.mktemp("synthetic") / "stamped"
    options = replace(
        TINY, actors=0, frames=9, variant="classic-21", fit_noise=True, ragged_masks=True
    )
    write_zju_tree(root, options)
    return root


def prepared(root: Path, name: str, out: Path) -> tuple[Path, float]:
    """The file, and the share of projected vertices inside the masks."""
    found = next(each for each in find_zju(root) if each.name == name)
    source = open_zju(found, OpenOptions(held_out=("CoreView_heldout00",)))
    report = prepare_sequence(source, out, PrepareOptions(scale=1.0, contact_sheet=False))
    assert report is not None
    assert report.stored == report.asked
    shares = [camera.inside for camera in report.cameras if camera.inside is not None]
    return out / f"{name}.h5", min(shares)


@pytest.mark.parametrize("actor", ["actor00", "heldout00"])
def test_a_prepared_tree_passes_its_check(tree: Path, tmp_path: Path, actor: str) -> None:
    path, inside = prepared(tree, f"CoreView_{actor}", tmp_path)
    findings = check_sequence(path, free_body_path())
    assert [each.sentence for each in findings if each.severity != "note"] == []
    assert inside > 0.9  # a pixel is 22 mm wide here
    with SequenceFile(path) as sequence:
        header = sequence.header
        assert header.actor == actor
        role = "held_out" if actor == "heldout00" else "pretraining"
        assert [protocol.role for protocol in header.protocols] == [role]
        assert header.provenance.dataset == "synthetic"


def test_the_root_says_what_it_is(tree: Path) -> None:
    assert (tree / "held_out.txt").read_text() == "CoreView_heldout00\n"
    sign = json.loads((tree / "synthetic.json").read_text())
    assert sign["format"] == "ZJU-MoCap"
    assert sign["frames"] == 10
    assert {each.dataset for each in find_zju(tree)} == {"synthetic"}


def test_it_is_written_as_the_real_data_are(tree: Path) -> None:
    folder = tree / "CoreView_actor00"
    annotations = load_npy(folder / "annots.npy")
    assert isinstance(annotations, dict)
    cams = annotations["cams"]
    assert [np.shape(cams[key][0]) for key in "KRTD"] == [(3, 3), (3, 3), (3, 1), (5, 1)]
    centre = -np.asarray(cams["R"][0]).T @ np.asarray(cams["T"][0])
    assert 2500 < np.linalg.norm(centre[:2]) < 3500  # millimetres
    assert centre[2, 0] < 0  # z points down, the camera stands above the floor
    assert len(annotations["ims"]) == 10
    assert annotations["ims"][3]["ims"] == ["Camera_B1/000003.jpg", "Camera_B2/000003.jpg"]
    image = cv2.imread(str(folder / "Camera_B1" / "000003.jpg"))
    labels = cv2.imread(str(folder / "mask_cihp" / "Camera_B1" / "000003.png"), -1)
    mask = cv2.imread(str(folder / "mask" / "Camera_B1" / "000003.png"), -1)
    assert image is not None
    assert labels is not None
    assert mask is not None
    assert image.shape == (128, 128, 3)
    assert set(np.unique(mask)) == {0, 1}
    assert len(np.unique(labels)) > 4
    np.testing.assert_array_equal(labels > 0, mask > 0)


def test_the_two_fits_differ_by_pose_blend_shapes(tree: Path) -> None:
    """`v = R(Rh) x + Th` with the packaged body gives back each fit's vertices."""
    folder, model = tree / "CoreView_actor00", free_body()
    for prefix, blend in (("", False), ("new_", True)):
        fit = load_npy(folder / f"{prefix}params" / "4.npy")
        assert isinstance(fit, dict)
        stored = np.load(folder / f"{prefix}vertices" / "4.npy")
        posed = pose(model, fit["shapes"][0], fit["poses"].reshape(24, 3), pose_blend=blend)
        world = posed.vertices @ matrix_from_axis_angle(fit["Rh"][0]).T + fit["Th"][0]
        np.testing.assert_allclose(stored, world, atol=1e-6)
        # The lowest vertices stand on the floor, z = 0 with z down.
        assert abs(stored[:, 2].max()) < 0.05
    old = np.load(folder / "vertices" / "4.npy")
    new = np.load(folder / "new_vertices" / "4.npy")
    assert 0.001 < np.abs(old - new).max() < 0.1


def test_what_is_missing_is_written_again_just_the_same(tree: Path, tmp_path: Path) -> None:
    """As after a crash: one actor is finished, of the other something is there."""
    root = tmp_path / "again"
    shutil.copytree(tree, root)
    (root / "synthetic.json").rename(root / "synthetic.json.part")
    (root / "held_out.txt").unlink()
    (root / "truth" / "CoreView_actor00.json").unlink()
    folder = root / "CoreView_actor00"
    (folder / "Camera_B1" / "000000.jpg").write_bytes(b"cut o")
    (folder / "annots.npy").unlink()
    untouched = root / "CoreView_heldout00" / "annots.npy"
    untouched.write_bytes(b"finished")
    write_zju_tree(root, TINY)
    assert untouched.read_bytes() == b"finished"
    untouched.write_bytes((tree / "CoreView_heldout00" / "annots.npy").read_bytes())
    files = [path.relative_to(tree) for path in sorted(tree.rglob("*")) if path.is_file()]
    assert files == [path.relative_to(root) for path in sorted(root.rglob("*")) if path.is_file()]
    for file in files:
        assert (root / file).read_bytes() == (tree / file).read_bytes(), file


def test_only_pictures_of_the_protocol_are_drawn(tree: Path) -> None:
    assert not list((tree / "CoreView_actor00" / "Camera_B2").iterdir())
    drawn = sorted(path.stem for path in (tree / "CoreView_heldout00/Camera_B2").iterdir())
    assert drawn == ["000006", "000007", "000008", "000009"]


def test_the_surface_that_the_first_camera_saw_is_kept(tree: Path) -> None:
    truth = json.loads((tree / "truth" / "CoreView_heldout00.json").read_text())
    seen = truth["first_camera"]
    first = seen["share_of_surface_seen_in_the_first_third"]
    whole = seen["share_of_surface_seen_in_all"]
    assert 0.1 < first < 0.5
    assert first < whole < 1


def test_names_with_time_stamps_count_from_one(imperfect: Path, tmp_path: Path) -> None:
    pictures = sorted((imperfect / "CoreView_heldout00" / "Camera (1)").iterdir())
    assert "_0001_2019-08-23_16-08-" in pictures[0].name
    assert not (imperfect / "CoreView_heldout00" / "new_params" / "0.npy").exists()
    path, inside = prepared(imperfect, "CoreView_heldout00", tmp_path)
    assert [each for each in check_sequence(path) if each.severity == "error"] == []
    assert 0.4 < inside < 0.88  # the fits' errors show
    with SequenceFile(path) as sequence:
        assert sequence.header.frames[0] == 1


def test_the_truth_is_kept_beside_imperfect_data(imperfect: Path) -> None:
    folder, truth = imperfect / "CoreView_heldout00", imperfect / "truth" / "CoreView_heldout00"
    with np.load(truth / "motion.npz") as true:
        fit = load_npy(folder / "new_params" / "3.npy")
        assert isinstance(fit, dict)
        angles = np.linalg.norm((fit["poses"].reshape(24, 3) - true["poses"][2])[1:], axis=1)
    assert 0.005 < angles.mean() < 0.1
    mask = next((folder / "mask_cihp" / "Camera (1)").iterdir())
    rough = cv2.imread(str(mask), -1)
    exact = cv2.imread(str(truth / "mask" / "Camera (1)" / mask.name), -1)
    assert rough is not None
    assert exact is not None
    assert 0 < ((rough > 0) != (exact > 0)).sum() < 0.3 * (exact > 0).sum()


def test_a_foreign_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(SourceError, match="is not empty and no synthetic data set"):
        write_zju_tree(tmp_path, TINY)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_more_cameras_than_the_stage_has_are_refused(tmp_path: Path) -> None:
    options = replace(TINY, variant="classic-21", cameras=22)
    with pytest.raises(SourceError, match="--cameras 22: a classic-21 tree has 21 cameras at most"):
        write_zju_tree(tmp_path / "new", options)
    assert not (tmp_path / "new").exists()


def test_bodies_have_shapes(tree: Path) -> None:
    truths = [json.loads(path.read_text()) for path in (tree / "truth").glob("*.json")]
    heights = [
        float(np.ptp(rest(free_body(), np.array(each["betas"]))[1][:, 1])) for each in truths
    ]
    assert abs(heights[0] - heights[1]) > 0.01
