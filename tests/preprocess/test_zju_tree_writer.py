from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.body_model import BodyModel, load_body_model
from actorsnerf_datasets.pickles import load_npy
from actorsnerf_preprocess.source import SourceCamera, SourceError
from actorsnerf_preprocess.zju_fits import RawFit
from actorsnerf_preprocess.zju_layouts import LAYOUTS
from actorsnerf_preprocess.zju_tree_writer import (
    AnnotatedTreeWriter,
    TreeWriter,
    world_mesh,
    write_image,
)

QUARTER_TURN = np.array([0.0, 0.0, np.pi / 2])
LABELS = np.array([[0, 5], [13, 0]], np.uint8)


def camera(name: str) -> SourceCamera:
    K = np.array([[100.0, 0, 1], [0, 101.0, 1], [0, 0, 1]])
    lens = np.array([-0.25, 0.1, 0.001, -0.0005, -0.02])
    return SourceCamera(name, 0, K, lens, np.eye(3), np.array([0.5, -1.0, 3.0]), (2, 2))


@pytest.fixture
def model(tiny_body: Path) -> BodyModel:
    return load_body_model(tiny_body)


@pytest.fixture
def fit(rng: np.random.Generator) -> RawFit:
    pose = rng.normal(0, 0.2, (24, 3))
    pose[0] = 0
    Th = np.array([1.0, 2.0, 3.0])
    return RawFit(pose, QUARTER_TURN, Th, np.zeros(10), padded=False)


def test_vertices_are_turned_about_the_origin_and_moved(model: BodyModel) -> None:
    """v = R(Rh) x + Th: a quarter turn about z takes x to y and y to -x."""
    still = RawFit(np.zeros((24, 3)), QUARTER_TURN, np.array([1.0, 2, 3]), np.zeros(10), False)
    x, y, z = model.template.T
    expected = np.stack([1 - y, 2 + x, 3 + z], axis=1)
    np.testing.assert_allclose(world_mesh(still, model, True), expected, atol=1e-6)


def test_annotations_are_in_millimetres_with_column_vectors(tmp_path: Path) -> None:
    writer = AnnotatedTreeWriter(tmp_path / "CoreView_1", LAYOUTS["classic-23"], 2)
    assert isinstance(writer, TreeWriter)
    writer.write_cameras([camera(name) for name in writer.cameras], range(3, 5))
    content = load_npy(writer.folder / "annots.npy")
    assert isinstance(content, dict)
    assert content["cams"]["T"][1].tolist() == [[500.0], [-1000.0], [3000.0]]
    assert content["cams"]["D"][0].shape == (5, 1)
    assert [each["ims"] for each in content["ims"]] == [
        ["Camera_B1/000003.jpg", "Camera_B2/000003.jpg"],
        ["Camera_B1/000004.jpg", "Camera_B2/000004.jpg"],
    ]


def test_trees_of_21_cameras_have_lists_in_place_of_arrays(tmp_path: Path) -> None:
    writer = AnnotatedTreeWriter(tmp_path / "CoreView_313", LAYOUTS["classic-21"], 1)
    writer.write_cameras([camera(name) for name in writer.cameras], range(1, 2))
    content = load_npy(writer.folder / "annots.npy")
    assert isinstance(content, dict)
    assert content["cams"]["T"] == [[[500.0], [-1000.0], [3000.0]]]
    assert isinstance(content["cams"]["K"][0], list)


def test_each_set_of_fits_has_its_vertices(tmp_path: Path, model: BodyModel, fit: RawFit) -> None:
    writer = AnnotatedTreeWriter(tmp_path / "CoreView_1", LAYOUTS["classic-23"], 1)
    writer.write_fits({7: fit}, model)
    for prefix, blend in (("", False), ("new_", True)):
        stored = np.load(writer.folder / f"{prefix}vertices" / "7.npy")
        assert stored.dtype == np.float32
        np.testing.assert_array_equal(stored, world_mesh(fit, model, blend))
        parameters = load_npy(writer.folder / f"{prefix}params" / "7.npy")
        assert isinstance(parameters, dict)
        shapes = {key: value.shape for key, value in parameters.items()}
        assert shapes == {"poses": (1, 72), "Rh": (1, 3), "Th": (1, 3), "shapes": (1, 10)}


def test_easymocap_leaves_the_root_out(tmp_path: Path, model: BodyModel, fit: RawFit) -> None:
    writer = AnnotatedTreeWriter(tmp_path / "aunt", LAYOUTS["easymocap"], 1)
    writer.write_fits({0: fit}, model)
    parameters = load_npy(writer.folder / "params" / "0.npy")
    assert isinstance(parameters, dict)
    np.testing.assert_array_equal(parameters["poses"], fit.pose[1:].reshape(1, 69))


def test_pictures_are_red_first_in_and_masks_have_labels_or_ones(tmp_path: Path) -> None:
    writer = AnnotatedTreeWriter(tmp_path / "CoreView_1", LAYOUTS["classic-23"], 1)
    red = np.zeros((8, 8, 3), np.uint8)
    red[..., 0] = 200
    writer.write_picture(0, 4, red, np.kron(LABELS, np.ones((4, 4), np.uint8)).astype(np.uint8))
    image = np.asarray(cv2.imread(str(writer.folder / "Camera_B1" / "000004.jpg")))
    assert np.abs(image.mean(axis=(0, 1)) - [0, 0, 200]).max() < 3  # OpenCV has blue first
    for folder, values in (("mask_cihp", {0, 5, 13}), ("mask", {0, 1})):
        mask = cv2.imread(str(writer.folder / folder / "Camera_B1" / "000004.png"), -1)
        assert set(np.unique(np.asarray(mask)).tolist()) == values


def test_folders_of_cameras_are_there_before_their_pictures(tmp_path: Path) -> None:
    layout = replace(LAYOUTS["refined"], masks=())
    AnnotatedTreeWriter(tmp_path / "my_1", layout, 2)
    assert sorted(path.name for path in (tmp_path / "my_1" / "images").iterdir()) == ["00", "01"]


def test_a_picture_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "000000.png").mkdir()
    with pytest.raises(SourceError, match=r"000000\.png: cannot be written; is the disk full\?"):
        write_image(tmp_path / "000000.png", LABELS)
