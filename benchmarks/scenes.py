"""What the benchmarks measure on: synthetic raw trees of real sizes, made once and kept.

They lie in `data/benchmarks`, which is not part of the repository. Drawing them takes much longer
than measuring.
"""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from actorsnerf_datasets.pickles import load_npy
from actorsnerf_preprocess.free_body import free_body_path
from actorsnerf_preprocess.stage import SyntheticOptions
from actorsnerf_preprocess.synthetic import write_aist_tree, write_zju_tree

SEED = 7
HOME = Path(__file__).resolve().parent.parent / "data" / "benchmarks"
BODY = free_body_path()
ZJU = SyntheticOptions(actors=1, held_out=0, frames=60, cameras=2, size=1024, seed=SEED, full=True)
"""120 pictures of ZJU-MoCap's size; every one is drawn."""
AIST = SyntheticOptions(actors=1, held_out=0, frames=240, cameras=2, size=1080, seed=SEED)
"""Two videos of 4 s in AIST++'s size; every fourth frame is prepared."""


def zju_sequence() -> Path:
    """The folder of one raw ZJU-MoCap sequence: 2 cameras, 60 frames of 1024 x 1024."""
    root = HOME / "zju"
    write_zju_tree(root, ZJU, progress=True)
    return root / "CoreView_actor00"


def aist_root() -> Path:
    """A raw AIST++ tree: one dancer, 2 videos of 1920 x 1080; masks of the truth under truth/."""
    root = HOME / "aist"
    write_aist_tree(root, AIST, progress=True)
    return root


def long_zju_sequence(frames: int) -> Path:
    """The ZJU-MoCap sequence with its frames repeated up to a number, as hard links.

    Measured runs are longer than starting processes takes, and the disk is not filled.
    """
    short = zju_sequence()
    target = HOME / f"zju-{frames}" / short.name
    if (target / "annots.npy").is_file():
        return target
    for folder in ("Camera_B1", "Camera_B2"):
        for base in ("", "mask", "mask_cihp"):
            (target / base / folder).mkdir(parents=True, exist_ok=True)
            suffix = ".png" if base else ".jpg"
            for frame in range(frames):
                source = short / base / folder / f"{frame % ZJU.frames:06d}{suffix}"
                _link(source, target / base / folder / f"{frame:06d}{suffix}")
    for folder in ("new_params", "new_vertices"):
        (target / folder).mkdir(exist_ok=True)
        for frame in range(frames):
            _link(short / folder / f"{frame % ZJU.frames}.npy", target / folder / f"{frame}.npy")
    shutil.copy(short.parent / "synthetic.json", target.parent / "synthetic.json")
    annotations: Any = load_npy(short / "annots.npy")
    names = ("Camera_B1", "Camera_B2")
    annotations["ims"] = [
        {"ims": [f"{name}/{frame:06d}.jpg" for name in names]} for frame in range(frames)
    ]
    np.save(target / "annots.npy", np.asarray(annotations))
    return target


def fresh(folder: Path, make: Callable[[Path], object]) -> Path:
    """A folder made anew."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    make(folder)
    return folder


def _link(source: Path, target: Path) -> None:
    if not target.exists():
        os.link(source, target)


if __name__ == "__main__":
    print(zju_sequence(), aist_root())
