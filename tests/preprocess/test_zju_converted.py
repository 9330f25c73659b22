import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.body_model import pose, rest
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import OpenOptions, SourceError
from actorsnerf_preprocess.zju import find_zju, open_zju, survey_zju
from actorsnerf_preprocess.zju_converted import converted_fits, read_converted_tree

WriteTree = Callable[..., Any]


def dump(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(content))


def load(path: Path) -> Any:
    return pickle.loads(path.read_bytes())


def convert(tree: Any, root: Path, shift: np.ndarray, cameras: bool = True) -> None:
    """What the released preparation writes, from a classic tree; optionally with shifted joints."""
    infos = {}
    for number in tree.frames:
        fit = np.load(tree.root / "new_params" / f"{number}.npy", allow_pickle=True).item()
        poses, betas, Rh = fit["poses"].reshape(24, 3), fit["shapes"][0], fit["Rh"][0]
        moved = shift * (1 + number)
        infos[f"frame_{number:06d}"] = {
            "Rh": Rh.astype(np.float32),
            "Th": (fit["Th"][0] - matrix_from_axis_angle(Rh) @ moved).astype(np.float32),
            "poses": poses.ravel().astype(np.float32),
            "joints": (pose(tree.model, betas, poses).joints + moved).astype(np.float32),
            "tpose_joints": (rest(tree.model, betas)[0] + moved).astype(np.float32),
        }
    for index in range(len(tree.names) if cameras else 1):
        folder = root / str(index) if cameras else root
        extrinsics = np.eye(4)
        extrinsics[:3, :3], extrinsics[:3, 3] = tree.R[index], tree.T[index]
        camera = {"intrinsics": tree.K[index].astype(np.float32), "extrinsics": extrinsics}
        camera["distortions"] = np.array([-0.25, 0.1, 0.001, -0.0005, -0.02], np.float32)
        dump(folder / "cameras.pkl", dict.fromkeys(infos, camera))
        dump(folder / "mesh_infos.pkl", infos)
        for number in tree.frames:
            name = f"{tree.names[index]}/{number:06d}"
            image = np.asarray(cv2.imread(str(tree.root / f"{name}.jpg")))
            mask = np.asarray(cv2.imread(str(tree.root / "mask_cihp" / f"{name}.png"), 0))
            three = np.repeat((mask > 0).astype(np.uint8)[..., None] * 255, 3, axis=-1)
            for kind, content in (("images", image), ("masks", three)):
                (folder / kind).mkdir(exist_ok=True)
                cv2.imwrite(str(folder / kind / f"frame_{number:06d}.png"), content)


@pytest.mark.parametrize("shift", [np.zeros(3), np.array([0.05, -0.1, 0.02])])
@pytest.mark.parametrize("cameras", [True, False])
def test_converted_trees_give_the_vertices_of_their_original(
    shift: np.ndarray, cameras: bool, tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    tree = write_zju(tmp_path / "raw" / "CoreView_377", frames=range(3), cameras=2)
    convert(tree, tmp_path / "converted" / "377", shift, cameras)
    (found,) = find_zju(tmp_path / "converted")
    assert found.dataset == "converted"
    source = open_zju(found, OpenOptions(body_model=tiny_body, pairs="all"))
    assert len(source.cameras) == (2 if cameras else 1)
    assert source.actor == "zju-377"
    for frame in range(3):
        matrix = source.fits.world_from_body[frame]
        world = source.fits.posed_vertices[frame] @ matrix[:3, :3].T + matrix[:3, 3]
        assert np.abs(world - tree.world_vertices[frame]).max() < 2e-5
    noted = any("this is undone" in note for note in source.notes)
    assert noted == bool(shift.any())


def test_a_converted_tree_is_prepared_and_marked(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    tree = write_zju(tmp_path / "raw" / "CoreView_377", frames=range(2), cameras=2)
    convert(tree, tmp_path / "377", np.zeros(3))
    (found,) = find_zju(tmp_path / "377")
    source = open_zju(found, OpenOptions(body_model=tiny_body, pairs="all"))
    report = prepare_sequence(source, tmp_path, PrepareOptions())
    assert report is not None and report.stored == 4
    with SequenceFile(tmp_path / "377.h5") as file:
        assert file.header.provenance.dataset == "converted"
        # Their pictures are raw; ours are undistorted.
        assert file.header.cameras[0].source_distortion[0] == pytest.approx(-0.25)


def test_vertices_one_level_up_are_used_and_verified(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377", frames=range(2), cameras=1)
    convert(tree, tmp_path / "zju" / "377", np.zeros(3))
    (tree.root / "new_vertices").rename(tmp_path / "zju" / "new_vertices")
    converted = read_converted_tree(tmp_path / "zju" / "377")
    read, _ = converted_fits(converted, (0, 1), tree.model)
    assert read.findings == ()
    for path in (tmp_path / "zju" / "new_vertices").iterdir():
        np.save(path, np.load(path) + 0.1)
    with pytest.raises(SourceError, match="2 of 2 frames differ"):
        converted_fits(converted, (0, 1), tree.model)


def test_the_survey_counts_missing_pictures(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "raw", frames=range(2), cameras=1)
    convert(tree, tmp_path / "377", np.zeros(3))
    (tmp_path / "377" / "0" / "images" / "frame_000001.png").unlink()
    survey = survey_zju(find_zju(tmp_path / "377")[0], OpenOptions())
    assert dict(survey.facts)["frames"] == "2: 0 to 1"
    assert survey.findings[0].sentence == "1 of 2 pictures are missing (first: 1)."


def test_a_camera_without_pictures_is_noted_unless_its_pictures_are_wanted(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    tree = write_zju(tmp_path / "raw" / "CoreView_377", frames=range(2), cameras=2)
    convert(tree, tmp_path / "377", np.zeros(3))
    for path in (tmp_path / "377" / "1" / "images").iterdir():
        path.unlink()
    (found,) = find_zju(tmp_path / "377")
    for pairs, severity in (("protocol", "note"), ("all", "warning")):
        options = OpenOptions(body_model=tiny_body, pairs="all" if pairs == "all" else "protocol")
        source = open_zju(found, options)
        assert source.cameras[1].size == source.cameras[0].size
        assert [(each.severity, each.entry, each.sentence) for each in source.findings] == [
            (severity, "camera 1", "No picture is readable; 160 x 160 is assumed."),
            (severity, "camera 1", "2 of 2 pictures are missing (first: 0)."),
        ]
    for path in (tmp_path / "377" / "0" / "images").iterdir():
        path.unlink()
    with pytest.raises(SourceError, match=r"0/images: has no readable picture frame_<number>.png"):
        open_zju(found, OpenOptions(body_model=tiny_body))


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("mesh_infos.pkl", lambda infos: {}, "expected a dictionary of frames"),
        ("mesh_infos.pkl", lambda infos: {"left": 1}, "entry 'left' is not a frame such as"),
        (
            "mesh_infos.pkl",
            lambda infos: {k: {**v, "poses": np.zeros(69)} for k, v in infos.items()},
            "frame_000000/poses should hold 72 finite numbers, found 69",
        ),
        (
            "cameras.pkl",
            lambda c: {**c, "frame_000001": {**c["frame_000001"], "intrinsics": np.eye(3)}},
            "the camera moves from frame to frame",
        ),
        (
            "cameras.pkl",
            lambda c: {k: {**v, "extrinsics": np.diag([1.0, 1, -1, 1])} for k, v in c.items()},
            "not a right-handed rotation",
        ),
    ],
)
def test_damaged_pickles_are_refused(
    file: str, change: Callable[[Any], Any], message: str, tmp_path: Path, write_zju: WriteTree
) -> None:
    tree = write_zju(tmp_path / "raw", frames=range(2), cameras=1)
    convert(tree, tmp_path / "377", np.zeros(3))
    path = tmp_path / "377" / "0" / file
    dump(path, change(load(path)))
    with pytest.raises(SourceError, match=message):
        read_converted_tree(tmp_path / "377")


def test_rest_joints_of_another_body_are_refused(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "raw", frames=range(2), cameras=1)
    convert(tree, tmp_path / "377", np.zeros(3))
    path = tmp_path / "377" / "0" / "mesh_infos.pkl"
    rng = np.random.default_rng(0)
    infos = load(path)
    for info in infos.values():
        info["tpose_joints"] = info["tpose_joints"] + rng.normal(0, 0.1, (24, 3))
    dump(path, infos)
    converted = read_converted_tree(tmp_path / "377")
    with pytest.raises(SourceError, match=r"mm for any shape.*another body model"):
        converted_fits(converted, (0, 1), tree.model)
