from collections.abc import Callable
from pathlib import Path
from typing import Any

from actorsnerf_preprocess.needs import Need, need_lines, needs_of
from actorsnerf_preprocess.source import Found, OpenOptions
from actorsnerf_preprocess.zju import find_zju

WriteTree = Callable[..., Any]


def test_missing_files_of_the_protocol_are_listed(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377")
    (tree.root / "Camera_B1" / "000001.jpg").unlink()
    (tree.root / "mask_cihp" / "Camera_B1" / "000002.png").unlink()
    (tree.root / "new_params" / "3.npy").unlink()
    # The protocol does not need the second camera.
    (tree.root / "Camera_B2" / "000001.jpg").unlink()
    pictures, masks, fits = needs_of(find_zju(tmp_path)[0], OpenOptions())
    assert pictures == Need("pictures", 4, (tree.root / "Camera_B1" / "000001.jpg",))
    assert masks == Need("masks", 4, (tree.root / "mask_cihp" / "Camera_B1" / "000002.png",))
    assert fits == Need("fits (new_params)", 4, (tree.root / "new_params" / "3.npy",))


def test_all_pairs_need_all_pictures(tmp_path: Path, write_zju: WriteTree) -> None:
    write_zju(tmp_path / "CoreView_377")
    needs = needs_of(find_zju(tmp_path)[0], OpenOptions(pairs="all"))
    assert [need.needed for need in needs] == [12, 12, 4]


def test_the_videos_of_a_dance_are_listed(tmp_path: Path) -> None:
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "gBR_sFM_c01_d04_mBR0_ch01.mp4").touch()
    found = Found("gBR_sFM_cAll_d04_mBR0_ch01", tmp_path, "AIST++", "aist++")
    (need,) = needs_of(found, OpenOptions())
    assert (need.needed, len(need.missing)) == (8, 7)
    assert need.missing[0] == Path("gBR_sFM_c02_d04_mBR0_ch01.mp4")


def test_lines_name_the_folders() -> None:
    found = Found("CoreView_377", Path("x"), "ZJU-MoCap", "zju-mocap")
    need = Need("pictures", 9, tuple(Path(f"a{n % 7}/{n}.jpg") for n in range(8)))
    lines = need_lines(found, (need,))
    assert lines[1] == "  pictures: 9 needed, 8 missing"
    assert lines[2] == "    a0: 2 missing, first 0.jpg"
    assert lines[-1] == "    ... and 2 more folders"
