from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_preprocess.source import SourceError
from actorsnerf_preprocess.zju_tree import is_zju_tree, read_tree

WriteTree = Callable[..., Any]


def annotations(root: Path) -> dict[str, Any]:
    content: dict[str, Any] = np.load(root / "annots.npy", allow_pickle=True).item()
    return content


def save(root: Path, content: dict[str, Any], name: str = "annots.npy") -> None:
    np.save(root / name, np.asarray(content), allow_pickle=True)


@pytest.mark.parametrize(
    ("variant", "name", "cameras", "picture"),
    [
        ("classic-23", "CoreView_377", ("Camera_B1", "Camera_B2"), "Camera_B2/000002.jpg"),
        ("renamed-21", "CoreView_313", ("Camera (1)", "Camera (2)"), "Camera (2)/0002.jpg"),
        ("refined", "my_377", ("00", "01"), "images/01/000002.jpg"),
        ("easymocap", "aunt", ("00", "01"), "images/01/00002.jpg"),
    ],
)
def test_the_variant_and_its_files_are_recognised(
    variant: str,
    name: str,
    cameras: tuple[str, ...],
    picture: str,
    tmp_path: Path,
    write_zju: WriteTree,
) -> None:
    write_zju(tmp_path / name, variant=variant, frames=range(1, 3), cameras=2)
    tree = read_tree(tmp_path / name, None)
    assert tree.variant == variant
    assert tree.camera_names == cameras
    assert tree.frames == (1, 2)
    assert tree.pictures[1, 1] == picture
    assert len(tree.existing) == 4
    assert [len(masks.files) for masks in tree.mask_sets] == [4]


def test_long_names_keep_their_own_time_stamps(tmp_path: Path, write_zju: WriteTree) -> None:
    write_zju(tmp_path / "CoreView_313", variant="classic-21", frames=range(1, 3), cameras=2)
    tree = read_tree(tmp_path / "CoreView_313", None)
    assert tree.variant == "classic-21"
    assert tree.frames == (1, 2)
    assert tree.pictures[1, 0].startswith("Camera (2)/CoreView_313_Camera_(2)_0001_2019-08-23_")
    assert len(tree.existing) == 4


def test_renamed_pictures_are_noted(tmp_path: Path, write_zju: WriteTree) -> None:
    write_zju(tmp_path / "CoreView_313", variant="renamed-21", frames=range(1, 2))
    notes = read_tree(tmp_path / "CoreView_313", None).notes
    assert any("renamed to their frame number" in note for note in notes)


def test_frames_come_in_ascending_order(tmp_path: Path, write_zju: WriteTree) -> None:
    root = tmp_path / "CoreView_377"
    write_zju(root, frames=range(3))
    content = annotations(root)
    save(root, {**content, "ims": content["ims"][::-1]})
    tree = read_tree(root, None)
    assert tree.frames == (0, 1, 2)
    assert tree.pictures[0, 2] == "Camera_B1/000002.jpg"


def test_new_annotations_without_pictures_take_them_from_the_old_ones(
    tmp_path: Path, write_zju: WriteTree
) -> None:
    root = tmp_path / "my_377"
    write_zju(root, variant="refined", frames=range(2))
    content = annotations(root)
    moved = {**content["cams"], "T": [t + 10.0 for t in content["cams"]["T"]]}
    save(root, {"cams": moved, "ims": []}, "annots_new.npy")
    tree = read_tree(root, None)
    assert tree.annotation_file.name == "annots_new.npy"
    assert tree.annotations.T[0, 0] == pytest.approx(content["cams"]["T"][0][0, 0] / 1000 + 0.01)
    assert len(tree.existing) == 6
    assert any("Cameras are those of annots_new.npy" in note for note in tree.notes)


def test_without_any_list_the_folders_are_listed(tmp_path: Path, write_zju: WriteTree) -> None:
    root = tmp_path / "my_377"
    write_zju(root, variant="refined", frames=range(2))
    save(root, {**annotations(root), "ims": []})
    tree = read_tree(root, None)
    assert tree.camera_names == ("00", "01", "02")
    assert len(tree.existing) == 6
    (root / "images" / "02").rename(root / "02")
    with pytest.raises(SourceError, match="has 2 folders of pictures for 3 cameras"):
        read_tree(root, None)


@pytest.mark.parametrize(("variant", "name"), [("classic-23", "Camera_B"), ("easymocap", "")])
def test_folders_are_paired_with_cameras_in_the_order_of_their_numbers(
    variant: str, name: str, tmp_path: Path, write_zju: WriteTree
) -> None:
    root = tmp_path / "aunt"
    tree = write_zju(root, variant=variant, cameras=11, frames=range(1), size=32)
    folders = root / "images" if variant == "easymocap" else root
    for index, old in reversed(list(enumerate(tree.names, start=1))):
        (folders / old).rename(folders / f"{name}{index}")
    save(root, {**annotations(root), "ims": []})
    found = read_tree(root, None)
    assert found.camera_names == tuple(f"{name}{index}" for index in range(1, 12))
    assert any(f"{name}9, {name}10, {name}11." in note for note in found.notes)


def test_time_stamped_pictures_that_nothing_lists_are_refused(
    tmp_path: Path, write_zju: WriteTree
) -> None:
    root = tmp_path / "CoreView_313"
    write_zju(root, variant="classic-21", frames=range(1, 3), cameras=2)
    save(root, {**annotations(root), "ims": []})
    with pytest.raises(SourceError, match=r"no file name is in all 2 folders .*Camera \(2\)/Core"):
        read_tree(root, None)


@pytest.mark.parametrize(
    ("frames", "kept"),
    [(range(809, 812), (810, 811)), (range(1348, 1352), (1348, 1349))],
    ids=["start", "end"],
)
def test_subject_396_is_read_from_frame_810_to_1349(
    frames: range, kept: tuple[int, ...], tmp_path: Path, write_zju: WriteTree
) -> None:
    root = tmp_path / "CoreView_396"
    write_zju(root, frames=frames, cameras=1)
    tree = read_tree(root, None)
    assert tree.frames == kept
    assert tree.pictures[0, 0] == f"Camera_B1/{kept[0]:06d}.jpg"
    assert any("from frame 810" in note for note in tree.notes)


def test_swapped_cameras_are_refused(tmp_path: Path, write_zju: WriteTree) -> None:
    root = tmp_path / "CoreView_377"
    write_zju(root)
    content = annotations(root)
    content["ims"][2]["ims"].reverse()
    save(root, content)
    with pytest.raises(SourceError, match=r"ims\[2\] lists the cameras in another order"):
        read_tree(root, None)


def test_pictures_without_numbers_and_repeated_frames_are_refused(
    tmp_path: Path, write_zju: WriteTree
) -> None:
    root = tmp_path / "CoreView_377"
    write_zju(root, cameras=1)
    content = annotations(root)
    save(root, {**content, "ims": [*content["ims"], content["ims"][0]]})
    with pytest.raises(SourceError, match="lists frame 0 twice"):
        read_tree(root, None)
    save(root, {**content, "ims": [{"ims": ["Camera_B1/first.jpg"]}]})
    with pytest.raises(
        SourceError, match=r"'Camera_B1/first.jpg' of annots.npy has no frame number"
    ):
        read_tree(root, None)


def test_two_cameras_of_one_folder_are_refused(tmp_path: Path, write_zju: WriteTree) -> None:
    root = tmp_path / "CoreView_377"
    write_zju(root, cameras=2, frames=range(1))
    save(root, {**annotations(root), "ims": [{"ims": ["a/0.jpg", "a/1.jpg"]}]})
    with pytest.raises(SourceError, match="have pictures in one folder 'a'"):
        read_tree(root, None)


def test_a_folder_without_annotations_is_refused(tmp_path: Path) -> None:
    assert not is_zju_tree(tmp_path)
    with pytest.raises(SourceError, match=r"has neither annots.npy nor annots_new.npy"):
        read_tree(tmp_path, None)
