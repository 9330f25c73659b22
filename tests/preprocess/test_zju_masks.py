from pathlib import Path

import pytest

from actorsnerf_preprocess.source import SourceError
from actorsnerf_preprocess.zju_masks import Listing, lost_masks, mask_sets, user_masks

CLASSIC = {(0, 0): "Camera_B1/000000.jpg", (0, 1): "Camera_B1/000001.jpg"}
REFINED = {(0, 0): "images/00/000000.jpg"}


def touch(root: Path, *names: str) -> None:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).touch()


def test_both_sets_are_found_and_each_may_be_incomplete(tmp_path: Path) -> None:
    touch(tmp_path, "mask/Camera_B1/000000.png", "mask_cihp/Camera_B1/000001.png")
    found = mask_sets(CLASSIC, Listing(tmp_path))
    assert [(s.name, s.files) for s in found] == [
        ("mask", {(0, 0): "mask/Camera_B1/000000.png"}),
        ("mask_cihp", {(0, 1): "mask_cihp/Camera_B1/000001.png"}),
    ]


@pytest.mark.parametrize(
    "name",
    ["mask/00/000000.png", "mask/images/00/000000.png", "mask/00/000000.jpg", "schp/00/000000.png"],
)
def test_refined_trees_have_masks_with_and_without_the_images_level(
    tmp_path: Path, name: str
) -> None:
    touch(tmp_path, name)
    (found,) = mask_sets(REFINED, Listing(tmp_path))
    assert found.files == {(0, 0): name}


def test_part_labels_are_used_only_without_masks(tmp_path: Path) -> None:
    touch(tmp_path, "schp/00/000000.png", "mask/00/000000.png")
    assert [s.name for s in mask_sets(REFINED, Listing(tmp_path))] == ["mask"]


def test_the_users_masks_replace_those_of_the_source(tmp_path: Path) -> None:
    root = tmp_path / "CoreView_377"
    touch(root, "mask/Camera_B1/000000.png")
    mine = tmp_path / "mine"
    touch(mine, "CoreView_377/Camera_B1/000001.png")
    (found,) = user_masks(mine, root, CLASSIC)
    assert found.files == {(0, 1): str((mine / "CoreView_377/Camera_B1/000001.png").resolve())}


def test_a_folder_without_any_mask_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"expected files such as .*Camera_B1/000000.png"):
        user_masks(tmp_path, tmp_path / "CoreView_377", CLASSIC)
    with pytest.raises(SourceError, match="no such folder of masks"):
        user_masks(tmp_path / "gone", tmp_path, CLASSIC)


def test_masks_renamed_onto_one_another_are_reported(tmp_path: Path) -> None:
    touch(tmp_path, "mask/Camera (1)/0001.png", "mask/Camera (2)/0001.png", "mask/Camera (2)/2.png")
    (finding,) = lost_masks(tmp_path, Listing(tmp_path))
    assert finding.sentence.startswith("1 folders hold one file each (for example Camera (1))")
