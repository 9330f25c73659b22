from pathlib import Path

import pytest

from actorsnerf_preprocess.aist_tree import find_tree
from actorsnerf_preprocess.source import SourceError

NAME = "gBR_sFM_cAll_d04_mBR0_ch01"


def touched(path: Path, content: bytes = b"x") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("cameras", "motions"),
    [
        ("cameras", "motions"),
        ("annotations/cameras", "annotations/motions"),
        ("20210308_cameras/cameras", "20210308_motions/motions"),
        ("a/aist_plusplus_final/cameras", "a/aist_plusplus_final/motions"),
    ],
)
@pytest.mark.parametrize("videos", ["", "videos", "videos/10M/c01"])
def test_parts_are_found_however_they_were_unpacked(
    tmp_path: Path, cameras: str, motions: str, videos: str
) -> None:
    touched(tmp_path / cameras / "mapping.txt")
    touched(tmp_path / motions / f"{NAME}.pkl")
    video = touched(tmp_path / videos / "gBR_sFM_c01_d04_mBR0_ch01.mp4")
    tree = find_tree(tmp_path)
    assert tree is not None
    assert (tree.cameras, tree.motions) == (tmp_path / cameras, tmp_path / motions)
    assert tree.videos == {NAME: {"c01": video}}
    assert tree.sequences() == (NAME,)
    assert tree.keypoints2d is None and tree.ignore_list is None and tree.notes == ()


def test_optional_parts_are_found(tmp_path: Path) -> None:
    touched(tmp_path / "cameras" / "mapping.txt")
    for kind in ("motions", "keypoints2d", "keypoints3d"):
        touched(tmp_path / kind / f"{NAME}.pkl")
    listed = touched(tmp_path / "ignore_list.txt")
    tree = find_tree(tmp_path)
    assert tree is not None
    assert tree.keypoints2d == tmp_path / "keypoints2d"
    assert tree.keypoints3d == tmp_path / "keypoints3d"
    assert tree.ignore_list == listed


def test_the_newer_of_two_motion_folders_is_taken_and_said(tmp_path: Path) -> None:
    touched(tmp_path / "cameras" / "mapping.txt")
    touched(tmp_path / "20210125_motions" / "motions" / f"{NAME}.pkl")
    newer = touched(tmp_path / "20210308_motions" / "motions" / f"{NAME}.pkl")
    tree = find_tree(tmp_path)
    assert tree is not None and tree.motions == newer.parent
    assert tree.notes == ("2 folders hold motions; taken: 20210308_motions/motions.",)


def test_parts_behind_links_to_folders_are_found(tmp_path: Path) -> None:
    disk, root = tmp_path / "disk", tmp_path / "aist"
    touched(disk / "annotations" / "cameras" / "mapping.txt")
    touched(disk / "annotations" / "motions" / f"{NAME}.pkl")
    touched(disk / "videos" / "10M" / "gBR_sFM_c01_d04_mBR0_ch01.mp4")
    root.mkdir()
    for name in ("annotations", "videos"):
        (root / name).symlink_to(disk / name)
    tree = find_tree(root)
    assert tree is not None and tree.notes == ()
    assert tree.motions == root / "annotations" / "motions"
    video = root / "videos" / "10M" / "gBR_sFM_c01_d04_mBR0_ch01.mp4"
    assert tree.videos == {NAME: {"c01": video}}


def test_a_folder_is_found_once_by_its_own_name_and_loops_of_links_end(tmp_path: Path) -> None:
    touched(tmp_path / "cameras" / "mapping.txt")
    motions = touched(tmp_path / "z" / "motions" / f"{NAME}.pkl").parent
    (tmp_path / "motions").symlink_to(motions)
    for place in (tmp_path, motions, tmp_path / "cameras"):
        for name in "abcdefgh":
            (place / name).symlink_to(tmp_path)
    tree = find_tree(tmp_path)
    assert tree is not None
    assert (tree.motions, tree.notes) == (motions, ())


def test_a_link_reaches_what_lies_too_deep_without_it(tmp_path: Path) -> None:
    touched(tmp_path / "cameras" / "mapping.txt")
    touched(tmp_path / "motions" / f"{NAME}.pkl")
    deep = tmp_path / "a" / "b" / "c" / "d" / "e"
    touched(deep / "10M" / "gBR_sFM_c01_d04_mBR0_ch01.mp4")
    tree = find_tree(tmp_path)
    assert tree is not None and tree.videos == {}
    (tmp_path / "videos").symlink_to(deep)
    tree = find_tree(tmp_path)
    assert tree is not None
    video = tmp_path / "videos" / "10M" / "gBR_sFM_c01_d04_mBR0_ch01.mp4"
    assert tree.videos == {NAME: {"c01": video}}


def test_the_larger_of_two_videos_of_a_view_is_taken(tmp_path: Path) -> None:
    touched(tmp_path / "cameras" / "mapping.txt")
    touched(tmp_path / "motions" / f"{NAME}.pkl")
    large = touched(tmp_path / "10M" / "gBR_sFM_c02_d04_mBR0_ch01.mp4", b"xxxx")
    touched(tmp_path / "2M" / "gBR_sFM_c02_d04_mBR0_ch01.mp4", b"xx")
    tree = find_tree(tmp_path)
    assert tree is not None and tree.videos == {NAME: {"c02": large}}


def test_the_truth_beside_a_synthetic_tree_is_never_read(tmp_path: Path) -> None:
    touched(tmp_path / "annotations" / "cameras" / "mapping.txt")
    motions = touched(tmp_path / "annotations" / "motions" / f"{NAME}.pkl").parent
    touched(tmp_path / "truth" / "motions" / f"{NAME}.pkl")
    tree = find_tree(tmp_path)
    assert tree is not None and tree.motions == motions


def test_a_folder_without_annotations_is_none_and_half_of_them_an_error(tmp_path: Path) -> None:
    touched(tmp_path / "gBR_sFM_c02_d04_mBR0_ch01.mp4")
    assert find_tree(tmp_path) is None
    touched(tmp_path / "motions" / f"{NAME}.pkl")
    with pytest.raises(SourceError, match=r"there is no cameras/mapping\.txt below it"):
        find_tree(tmp_path)
    touched(tmp_path / "deep" / "cameras" / "mapping.txt")
    (tmp_path / "motions" / f"{NAME}.pkl").unlink()
    with pytest.raises(SourceError, match=r"there is no motions/\*\.pkl below it"):
        find_tree(tmp_path)
