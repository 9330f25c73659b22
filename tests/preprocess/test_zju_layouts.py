from typing import get_args

import pytest

from actorsnerf_preprocess.zju_layouts import LAYOUTS, TreeVariant
from actorsnerf_preprocess.zju_tree import Variant


def test_every_variant_that_is_recognised_has_a_layout() -> None:
    assert set(LAYOUTS) == set(get_args(Variant))
    assert set(get_args(TreeVariant)) - set(LAYOUTS) == {
        "converted-humannerf",
        "converted-actorsnerf",
    }


def test_the_stage_with_21_cameras_has_no_20th_and_21st() -> None:
    for variant in ("classic-21", "renamed-21"):
        names = LAYOUTS[variant].cameras
        assert len(names) == 21
        assert names[18:] == ("Camera (19)", "Camera (22)", "Camera (23)")
    assert LAYOUTS["classic-23"].cameras[22] == "Camera_B23"


@pytest.mark.parametrize(
    ("variant", "folder", "listed", "stored", "masks"),
    [
        (
            "classic-23",
            "CoreView_377",
            "Camera_B3/000012.jpg",
            "Camera_B3/000012.jpg",
            ["mask_cihp/Camera_B3/000012.png", "mask/Camera_B3/000012.png"],
        ),
        (
            "renamed-21",
            "CoreView_315",
            "Camera (3)/CoreView_315_Camera_(3)_0012_2019-08-23_16-08-00.369.jpg",
            "Camera (3)/0012.jpg",
            ["mask_cihp/Camera (3)/0012.png"],
        ),
        (
            "refined",
            "my_377",
            "images/02/000012.jpg",
            "images/02/000012.jpg",
            ["mask/02/000012.png"],
        ),
        (
            "easymocap",
            "aunt",
            "images/02/00012.jpg",
            "images/02/00012.jpg",
            ["mask_cihp/images/02/00012.png"],
        ),
    ],
)
def test_files_are_called_as_in_the_documented_trees(
    variant: Variant, folder: str, listed: str, stored: str, masks: list[str]
) -> None:
    layout = LAYOUTS[variant]
    assert layout.folder.format(actor=folder.rpartition("_")[2]) == folder
    assert layout.listed_name(folder, 2, 12) == listed
    assert layout.stored_name(folder, 2, 12) == stored
    assert [layout.mask_name(each, folder, 2, 12) for each in layout.masks] == masks


def test_a_mask_keeps_the_stamp_of_its_picture() -> None:
    layout = LAYOUTS["classic-21"]
    # 2200 frames after the first are 73.333 s; the 19th camera is 18 ms later than the first.
    name = "Camera (19)/CoreView_313_Camera_(19)_2201_2019-08-23_16-09-13.351"
    assert layout.stored_name("CoreView_313", 18, 2201) == f"{name}.jpg"
    mask = layout.mask_name(layout.masks[0], "CoreView_313", 18, 2201)
    assert mask == f"mask_cihp/{name}.png"
