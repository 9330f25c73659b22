from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_preprocess.source import OpenOptions, SourceError
from actorsnerf_preprocess.zju import find_zju
from actorsnerf_preprocess.zju_inspection import ZjuInspection, facts, inspect_zju, source_digests

WriteTree = Callable[..., Any]


def inspected(tree: Any) -> ZjuInspection:
    return inspect_zju(find_zju(tree.root)[0], OpenOptions())


def sentences(seen: ZjuInspection) -> dict[str, str]:
    return {finding.entry: finding.sentence for finding in seen.findings}


def test_a_tree_in_order_has_only_notes(tmp_path: Path, write_zju: WriteTree) -> None:
    seen = inspected(write_zju(tmp_path / "CoreView_377"))
    assert {finding.severity for finding in seen.findings} == {"note"}
    found = dict(facts(seen))
    assert found["masks"] == "source folder mask_cihp; not zero = person"
    assert found["fits"] == "new_params, params"
    assert found["picture size"] == "160 x 160"


def test_a_picture_has_all_its_masks(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377", frames=range(2), cameras=1)
    (tree.root / "mask" / "Camera_B1").mkdir(parents=True)
    (tree.root / "mask" / "Camera_B1" / "000001.png").touch()
    seen = inspected(tree)
    assert seen.picture_files(0, 0).masks == ("mask_cihp/Camera_B1/000000.png",)
    assert seen.picture_files(0, 1).masks == (
        "mask/Camera_B1/000001.png",
        "mask_cihp/Camera_B1/000001.png",
    )
    assert sentences(seen)["mask"] == "1 of 2 pictures have no file here: Camera_B1 1."


def test_masks_of_the_user_hold_shares(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377", cameras=1)
    mine = tmp_path / "mine"
    (tree.root / "mask_cihp").rename(mine)
    seen = inspect_zju(find_zju(tree.root)[0], OpenOptions(masks=mine))
    assert seen.picture_files(0, 0).given
    assert not inspected(tree).picture_files(0, 0).given
    source = dict(facts(seen))["masks"]
    assert source == f"given by the user ({mine}); levels or alpha = the person's share"


def test_missing_masks_are_an_error(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377")
    (tree.root / "mask_cihp").rename(tree.root / "masks_somewhere")
    seen = inspected(tree)
    assert [f.entry for f in seen.findings if f.severity == "error"] == ["masks"]
    assert sentences(seen)["masks"].startswith("No masks: looked for mask/, mask_cihp/")


def test_no_picture_at_all_is_refused(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377", cameras=1)
    (tree.root / "Camera_B1").rename(tree.root / "pictures")
    with pytest.raises(SourceError, match=r"none of the 4 pictures .*Camera_B1/000000.jpg"):
        inspected(tree)


def test_a_camera_without_pictures_is_named(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377", cameras=2)
    (tree.root / "Camera_B2").rename(tree.root / "pictures")
    assert sentences(inspected(tree))["Camera_B2"].startswith("No picture of this camera is")


@pytest.mark.parametrize("side", [160, 720])
def test_intrinsics_of_the_released_size_are_scaled_to_resized_pictures(
    side: int, tmp_path: Path, write_zju: WriteTree
) -> None:
    tree = write_zju(tmp_path / "CoreView_377", cameras=1, frames=range(1), size=side)
    content = np.load(tree.root / "annots.npy", allow_pickle=True).item()
    full = np.array([[1040.0, 0, 520], [0, 1050, 500], [0, 0, 1]])
    content["cams"]["K"] = [full]
    np.save(tree.root / "annots.npy", np.asarray(content), allow_pickle=True)
    seen = inspected(tree)
    # The centre of the picture stays its centre.
    factor = side / 1024
    assert seen.cameras[0].K[0, 0] == pytest.approx(1040 * factor)
    assert seen.cameras[0].K[0, 2] == pytest.approx(520.5 * factor - 0.5)
    sentence = sentences(seen)["annots.npy/cams/K"]
    assert sentence.startswith(
        f"Pictures of 1 cameras are {side} x {side}, not 1024 x 1024: K belongs to 1024 x 1024 and "
    )
    assert sentence in seen.notes


def test_a_principal_point_off_the_picture_is_named(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377", cameras=1)
    content = np.load(tree.root / "annots.npy", allow_pickle=True).item()
    content["cams"]["K"] = [np.array([[1040.0, 0, 5000], [0, 1050, 500], [0, 0, 1]])]
    np.save(tree.root / "annots.npy", np.asarray(content), allow_pickle=True)
    assert "[5000.0, 500.0] is far from the" in sentences(inspected(tree))["Camera_B1/K"]


def test_spare_folders_and_calibrations_are_noted(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_313", variant="classic-21", frames=range(1, 3))
    (tree.root / "Camera (20)").mkdir()
    (tree.root / "extri.yml").touch()
    found = sentences(inspected(tree))
    assert found["cameras"] == "Folders without camera parameters are not used: Camera (20)."
    assert "are not read" in found["extri.yml"]


def test_the_size_is_that_of_the_first_readable_picture(
    tmp_path: Path, write_zju: WriteTree
) -> None:
    tree = write_zju(tmp_path / "CoreView_377", cameras=1)
    (tree.root / "Camera_B1" / "000000.jpg").write_bytes(b"cut off")
    assert inspected(tree).cameras[0].size == (160, 160)
    cv2.imwrite(str(tree.root / "Camera_B1" / "000000.jpg"), np.zeros((160, 170, 3), np.uint8))
    assert inspected(tree).cameras[0].size == (170, 160)


def test_digests_change_with_a_byte_and_with_a_name(tmp_path: Path) -> None:
    (tmp_path / "fits").mkdir()
    (tmp_path / "fits" / "0.npy").write_bytes(b"a")
    first = source_digests(tmp_path, ("fits",))
    (tmp_path / "fits" / "0.npy").write_bytes(b"b")
    second = source_digests(tmp_path, ("fits",))
    (tmp_path / "fits" / "0.npy").rename(tmp_path / "fits" / "1.npy")
    third = source_digests(tmp_path, ("fits",))
    assert [name for name, _ in first] == ["fits/"]
    assert len({first[0][1], second[0][1], third[0][1]}) == 3
