from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.body_model import BodyModel, load_body_model, rest
from actorsnerf_datasets.pickles import load_pickle
from actorsnerf_preprocess.source import SourceCamera
from actorsnerf_preprocess.zju_converted_writer import (
    ACTORSNERF,
    HUMANNERF,
    ConvertedTreeWriter,
)
from actorsnerf_preprocess.zju_fits import RawFit
from actorsnerf_preprocess.zju_tree_writer import TreeWriter, world_mesh


def camera(index: int) -> SourceCamera:
    K = np.array([[100.1, 0, 1], [0, 101.0, 1], [0, 0, 1]])
    T = np.array([0.5, -1.0, 3.0 + index])
    return SourceCamera(str(index), index, K, np.full(5, 0.1), np.eye(3), T, (8, 8))


@pytest.fixture
def model(tiny_body: Path) -> BodyModel:
    return load_body_model(tiny_body)


def fits(rng: np.random.Generator) -> dict[int, RawFit]:
    return {
        number: RawFit(
            rng.normal(0, 0.2, (24, 3)) * (np.arange(24) > 0)[:, None],
            rng.normal(0, 0.5, 3),
            rng.normal(0, 0.5, 3),
            rng.normal(0, 0.5, 10),
            padded=False,
        )
        for number in range(2)
    }


def test_humannerf_has_one_camera_at_the_top(tmp_path: Path) -> None:
    writer = ConvertedTreeWriter(tmp_path / "377", HUMANNERF, 3)
    assert isinstance(writer, TreeWriter)
    assert len(writer.cameras) == 1
    writer.write_cameras([camera(0)], range(2))
    assert writer.picture_name(0, 4) == "images/frame_000004.png"
    content = load_pickle(tmp_path / "377" / "cameras.pkl")
    assert isinstance(content, dict)
    assert list(content) == ["frame_000000", "frame_000001"]
    entry = content["frame_000001"]
    assert entry["intrinsics"].dtype == np.float32
    assert entry["extrinsics"][:, 3].tolist() == [0.5, -1.0, 3.0, 1.0]  # metres
    assert entry["distortions"].shape == (5,)


def test_actorsnerf_has_a_folder_per_camera_and_vertices_beside(
    tmp_path: Path, model: BodyModel, rng: np.random.Generator
) -> None:
    writer = ConvertedTreeWriter(tmp_path / "377", ACTORSNERF, 2)
    writer.write_cameras([camera(0), camera(1)], range(2))
    made = fits(rng)
    writer.write_fits(made, model)
    assert writer.picture_name(1, 4) == "1/images/frame_000004.png"
    for name in ("0", "1"):
        infos = load_pickle(tmp_path / "377" / name / "mesh_infos.pkl")
        assert isinstance(infos, dict)
        shapes = {key: value.shape for key, value in infos["frame_000001"].items()}
        assert shapes == {
            "Rh": (3,),
            "Th": (3,),
            "poses": (72,),
            "joints": (24, 3),
            "tpose_joints": (24, 3),
        }
        joints = rest(model, made[1].betas)[0]
        np.testing.assert_allclose(infos["frame_000001"]["tpose_joints"], joints, atol=1e-6)
    canonical = load_pickle(tmp_path / "377" / "0" / "canonical_joints.pkl")
    assert isinstance(canonical, dict)
    mean = (made[0].betas + made[1].betas) / 2
    np.testing.assert_allclose(canonical["joints"], rest(model, mean)[0], atol=1e-6)
    stored = np.load(tmp_path / "377" / "new_vertices" / "1.npy")
    np.testing.assert_array_equal(stored, world_mesh(made[1], model, True))
    assert np.load(tmp_path / "377" / "lbs" / "tvertices.npy").shape == model.template.shape


def test_pictures_lose_what_jpeg_loses_and_nothing_more(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    writer = ConvertedTreeWriter(tmp_path / "377", HUMANNERF, 1)
    rgb = rng.integers(0, 256, (8, 8, 3)).astype(np.uint8)
    labels = np.zeros((8, 8), np.uint8)
    labels[2:5, 1:7] = 13
    writer.write_picture(0, 0, rgb, labels)
    cv2.imwrite(str(tmp_path / "raw.jpg"), np.ascontiguousarray(rgb[..., ::-1]))
    raw = np.asarray(cv2.imread(str(tmp_path / "raw.jpg")))
    stored = np.asarray(cv2.imread(str(tmp_path / "377" / "images" / "frame_000000.png")))
    np.testing.assert_array_equal(stored, raw)
    mask = np.asarray(cv2.imread(str(tmp_path / "377" / "masks" / "frame_000000.png"), -1))
    assert mask.shape == (8, 8, 3)
    np.testing.assert_array_equal(mask[..., 1], np.where(labels > 0, 255, 0))
