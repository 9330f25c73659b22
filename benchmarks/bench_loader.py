"""What training reads per second: our loader against the released layout and PNG files of crops."""

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from records import Table, record
from released import ReleasedLoader, write_released
from scenes import BODY, HOME, SEED, fresh, zju_sequence
from torch.utils.data import DataLoader

from actorsnerf_datasets.body_box import body_box
from actorsnerf_datasets.patches import PatchScene, draw_patches
from actorsnerf_datasets.picture_cache import PictureCache
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.torch_dataset import PretrainingDataset
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import OpenOptions
from actorsnerf_preprocess.zju import find_zju, open_zju

K, PATCHES, SIDE = 3, 6, 32
"""Supports per sample, patches and their side: the published pre-training's."""


@dataclass(frozen=True)
class Speed:
    """What one way of loading does."""

    wall: float
    """Seconds per sample."""
    cpu: float
    first: float
    """Seconds from nothing open to the first sample."""
    rays: int
    """Of a sample."""


def main() -> None:
    """Measures and records."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=60)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    places = written()
    tables = [
        in_one_process(places, arguments.samples, arguments.repeats),
        in_workers(places["ours"], arguments.samples),
    ]
    record("loader", "What training reads", SEED, tables)


@dataclass(frozen=True)
class Loader:
    """One way of loading."""

    name: str
    place: Path
    """File or folder that it reads; all of it counts as stored."""
    make: Callable[[], Callable[[int], int]]
    """Opens it; the result loads the sample of an index and says how many rays it has."""


def loaders(places: dict[str, Path]) -> tuple[Loader, ...]:
    """The ways that are compared; the first is the measure of the others."""
    old, crops, new = places["released"], places["crops"], places["ours"]
    return (
        Loader("released layout, as published", old, lambda: released(old, False)),
        Loader("released layout, supports undistorted too", old, lambda: released(old, True)),
        Loader("PNG files of our crops", crops, lambda: cropped(crops)),
        Loader("ours, every picture decoded anew", new, lambda: ours(new, 0)),
        Loader("ours, pictures kept once decoded", new, lambda: ours(new, None)),
    )


def in_one_process(places: dict[str, Path], samples: int, repeats: int) -> Table:
    """Every way of loading in this process, per CPU second."""
    compared = loaders(places)
    speeds = [speed(loader.make, samples, repeats) for loader in compared]
    rows = [
        (
            loader.name,
            (K + 1) / found.cpu,
            found.rays / found.cpu,
            f"{speeds[0].cpu / found.cpu:.1f}",
            int(size(loader.place)),
            1000 * found.first,
        )
        for loader, found in zip(compared, speeds, strict=True)
    ]
    return Table(
        f"One process: samples of a target, {K} supports and {PATCHES} patches of {SIDE} x {SIDE}",
        (
            "loader",
            "pictures/s",
            "rays/s",
            "times the released",
            "bytes per picture",
            "first sample, ms",
        ),
        tuple(rows),
        "Per CPU second of one process; files in the page cache. Aim: at least 10 times the "
        "released layout, from fewer bytes. Bytes are the whole of what is stored, over the 60 "
        "pictures: vertices, poses and cameras too.",
    )


def written() -> dict[str, Path]:
    """The same 60 pictures of one camera in the three layouts."""
    folder = zju_sequence()
    source = open_zju(find_zju(folder)[0], OpenOptions(body_model=BODY, pairs="protocol"))
    home = HOME / "loader"
    file = home / "ours" / f"{source.found.name}.h5"
    if not file.is_file():
        fresh(
            home / "ours",
            lambda out: prepare_sequence(source, out, PrepareOptions(contact_sheet=False)),
        )
        fresh(home / "released", lambda out: write_released(out, source))
        fresh(home / "crops", lambda out: write_crops(out, file))
    return {"ours": file, "released": home / "released", "crops": home / "crops"}


def write_crops(out: Path, prepared: Path) -> None:
    """Our crops as RGBA PNG files, all else as one .npz."""
    with SequenceFile(prepared) as file:
        fits = file.complete_header().fits
        frames = range(len(fits.transl))
        for frame in frames:
            picture = file.picture(0, frame)
            rgba = np.dstack([picture.rgb[..., ::-1], picture.alpha])
            cv2.imwrite(str(out / f"{frame:06d}.png"), rgba)
        np.savez(
            out / "rest.npz",
            K=np.stack([file.crop_K(0, frame) for frame in frames]),
            camera=np.stack([file.camera_from_body(0, frame) for frame in frames]),
            joints=fits.posed_joints,
            vertices=fits.posed_vertices,
        )


def released(root: Path, supports: bool) -> Callable[[int], int]:
    """The released layout's loader."""
    loader = ReleasedLoader(root, supports)
    return lambda index: loader.sample(np.random.default_rng([SEED, index]), K, PATCHES, SIDE)


def cropped(root: Path) -> Callable[[int], int]:
    """A loader of PNG crops that does what ours does."""
    with np.load(root / "rest.npz") as arrays:
        rest = dict(arrays)
    names = sorted(root.glob("*.png"))

    def view(frame: int) -> tuple[np.ndarray, np.ndarray]:
        rgba = np.asarray(cv2.imread(str(names[frame]), cv2.IMREAD_UNCHANGED))
        image = rgba[..., 2::-1].astype(np.float32) / 255
        share = rgba[..., 3].astype(np.float32) / 255
        return np.ascontiguousarray(image), share

    def sample(index: int) -> int:
        rng = np.random.default_rng([SEED, index])
        target, *supports = rng.choice(len(names), size=K + 1, replace=False).tolist()
        _, share = view(target)
        for support in supports:
            view(support)
        scene = PatchScene(
            (share * 255).astype(np.uint8),
            rest["K"][target],
            rest["camera"][target],
            body_box(rest["joints"][target]),
            (0, 0),
            (share.shape[1], share.shape[0]),
        )
        return int(np.prod(draw_patches(rng, scene, PATCHES, SIDE).shape[:3]))

    return sample


def ours(path: Path, cache: int | None) -> Callable[[int], int]:
    """Our loader, with a cache of so many bytes (None: its own)."""
    dataset = PretrainingDataset([path], SEED, K, PATCHES, SIDE, 10**6)
    if cache is not None:
        dataset._cache = PictureCache(cache)
    return lambda index: int(np.prod(dataset[index].patches.shape[:3]))


def speed(make: Callable[[], Callable[[int], int]], samples: int, repeats: int) -> Speed:
    """Medians over repetitions; the first samples of a loader count as its start."""
    firsts, walls, cpus, rays = [], [], [], 0
    for _ in range(repeats):
        started = time.perf_counter()
        sample = make()
        sample(0)
        firsts.append(time.perf_counter() - started)
        for index in range(1, 20):
            sample(index)
        wall, cpu = time.perf_counter(), time.process_time()
        for index in range(20, 20 + samples):
            rays = sample(index)
        walls.append((time.perf_counter() - wall) / samples)
        cpus.append((time.process_time() - cpu) / samples)
    return Speed(statistics.median(walls), statistics.median(cpus), statistics.median(firsts), rays)


def in_workers(path: Path, samples: int) -> Table:
    """Our loader in worker processes, by the clock."""
    rows = []
    for workers in (0, 1, 2):
        dataset = PretrainingDataset([path], SEED, K, PATCHES, SIDE, 8 * samples)
        dataset._cache = PictureCache(0)
        started = time.perf_counter()
        iterator = iter(DataLoader(dataset, batch_size=None, num_workers=workers))
        next(iterator)
        first = time.perf_counter() - started
        for _ in range(19):
            next(iterator)
        started = time.perf_counter()
        count = sum(1 for _ in iterator)
        seconds = time.perf_counter() - started
        rows.append((workers, (K + 1) * count / seconds, 1000 * first))
    return Table(
        "Ours in worker processes, every picture decoded anew",
        ("workers", "pictures/s", "first sample, ms"),
        tuple(rows),
        "By the clock. Samples travel to the training process through shared memory.",
    )


def size(path: Path) -> float:
    """Bytes per picture of a file, or of all files below a folder."""
    files = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
    return sum(one.stat().st_size for one in files) / 60


if __name__ == "__main__":
    main()
