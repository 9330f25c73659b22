import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_preprocess.aist import find_aist
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
    lost = (tree.root / "Camera_B1" / "000001.jpg",)
    assert pictures == Need("pictures", 4, lost, ("Camera_B1: 4 frames, 0 to 3",))
    assert masks == Need("masks", 4, (tree.root / "mask_cihp" / "Camera_B1" / "000002.png",))
    assert fits == Need("fits (new_params)", 4, (tree.root / "new_params" / "3.npy",))


def test_all_pairs_need_all_pictures(tmp_path: Path, write_zju: WriteTree) -> None:
    write_zju(tmp_path / "CoreView_377")
    needs = needs_of(find_zju(tmp_path)[0], OpenOptions(pairs="all"))
    assert [need.needed for need in needs] == [12, 12, 4]


@pytest.mark.parametrize(("held_out", "needed"), [((), ["c01"]), (("d31",), [*"12345678"])])
def test_a_dance_needs_the_videos_of_its_role(
    held_out: tuple[str, ...], needed: list[str], tmp_path: Path, write_aist: Any
) -> None:
    """Pre-training sees only the first camera; a held-out dancer is seen by eight."""
    aist = write_aist(tmp_path, frames=12)  # enough for a few-shot list
    names = [aist.name.replace("cAll", f"c0{each[-1]}") + ".mp4" for each in needed]
    (found,) = find_aist(aist.root)
    (need,) = needs_of(found, OpenOptions(held_out=held_out))
    assert (need.what, need.needed, list(need.which)) == ("videos", len(needed), names)
    assert [path.name for path in need.missing] == names[3:]  # three views are there
    (every,) = needs_of(found, OpenOptions(pairs="all"))
    assert every.needed == 8


def test_pictures_are_listed_per_camera(tmp_path: Path, write_zju: WriteTree) -> None:
    write_zju(tmp_path / "aunt", variant="easymocap", frames=range(20))
    pictures, *_ = needs_of(find_zju(tmp_path)[0], OpenOptions(held_out=("aunt",)))
    assert pictures.which[1].startswith("01 to 02: 8 frames each, 12")


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
    pictures = Need("pictures", 3, (), ("camera 0: 3 frames, 0 to 2",))
    assert needs[:2] == (pictures, Need("masks", 3, (lost,)))
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
