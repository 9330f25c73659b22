import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from actorsnerf_preprocess.needs import ORIGINS, Need, need_lines, needs_of
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


def write_converted(root: Path, cameras: int, frames: int) -> None:
    """A tree as HumanNeRF's and ActorsNeRF's scripts leave it, of black pictures."""
    sizes = {"Rh": 3, "Th": 3, "poses": 72, "joints": 72, "tpose_joints": 72}
    infos = {
        f"frame_{frame:06d}": {key: np.zeros(size) for key, size in sizes.items()}
        for frame in range(frames)
    }
    camera = {"intrinsics": np.eye(3), "extrinsics": np.eye(4), "distortions": np.zeros(5)}
    for index in range(cameras):
        folder = root / str(index)
        for kind in ("images", "masks"):
            (folder / kind).mkdir(parents=True)
            for name in infos:
                cv2.imwrite(str(folder / kind / f"{name}.png"), np.zeros((8, 8, 3), np.uint8))
        (folder / "mesh_infos.pkl").write_bytes(pickle.dumps(infos))
        (folder / "cameras.pkl").write_bytes(pickle.dumps(dict.fromkeys(infos, camera)))


def test_converted_trees_say_what_they_need_too(tmp_path: Path) -> None:
    root = tmp_path / "377"
    write_converted(root, cameras=2, frames=3)
    (root / "0" / "masks" / "frame_000001.png").unlink()
    (root / "1" / "images" / "frame_000002.png").unlink()  # not in the protocol
    (found,) = find_zju(tmp_path)
    needs = needs_of(found, OpenOptions())
    lost = root / "0" / "masks" / "frame_000001.png"
    assert needs[:2] == (Need("pictures", 3, ()), Need("masks", 3, (lost,)))
    assert [need.what for need in needs[2:]] == ["cameras (cameras.pkl)", "fits (mesh_infos.pkl)"]
    every = needs_of(found, OpenOptions(pairs="all"))
    assert [need.needed for need in every] == [6, 6, 2, 1]
    assert [len(need.missing) for need in every] == [1, 1, 0, 0]
    assert "masks: 3 needed, 1 missing" in "\n".join(need_lines(found, needs))
    assert any("HumanNeRF" in line and "mesh_infos.pkl" in line for line in ORIGINS)


def test_lines_name_the_folders() -> None:
    found = Found("CoreView_377", Path("x"), "ZJU-MoCap", "zju-mocap")
    need = Need("pictures", 9, tuple(Path(f"a{n % 7}/{n}.jpg") for n in range(8)))
    lines = need_lines(found, (need,))
    assert lines[1] == "  pictures: 9 needed, 8 missing"
    assert lines[2] == "    a0: 2 missing, first 0.jpg"
    assert lines[-1] == "    ... and 2 more folders"
