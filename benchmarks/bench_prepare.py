"""How fast raw pictures become a prepared file, against what cannot be avoided, and in what memory.

Given masks: with 1 and 2 workers, against decoding, undistorting and compressing alone, in turn in
the same run. By the clock and in CPU time, which other work on the machine disturbs little. Made
masks have their own seconds per picture.
"""

import argparse
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Literal, TypeVar

import cv2
import numpy as np
from records import Table, record, stopwatch
from scenes import BODY, HOME, SEED, ZJU, aist_root, fresh, long_zju_sequence

from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import Picture
from actorsnerf_datasets.writer import encode_picture
from actorsnerf_preprocess.aist import find_aist, open_aist
from actorsnerf_preprocess.aist_reader import AistReader
from actorsnerf_preprocess.image_files import READ_FLAGS, ImageReader
from actorsnerf_preprocess.masks import make_mask
from actorsnerf_preprocess.pictures import Crop, lens_of, undistorted
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import OpenOptions, SourceSequence
from actorsnerf_preprocess.workers import team
from actorsnerf_preprocess.zju import find_zju, open_zju

WHOLE = "decode, undistort, compress alone"
CROP = "decode, undistort the crop, compress alone"
PREPARE = {1: "prepare, 1 worker", 2: "prepare, 2 workers"}
"""By the number of workers."""
OUT = HOME / "prepared"

Result = TypeVar("Result")
Row = tuple[str | float | int, ...]


@dataclass(frozen=True)
class Run:
    """One preparation, or what it cannot leave out."""

    wall: float
    """Seconds of the pictures: processes are running already, as in a run over many sequences."""
    cpu: float
    """CPU seconds of the pictures, in all processes."""
    start: float = 0.0
    """Seconds until all worker processes are ready."""
    worker_peak: float = 0.0
    """Largest resident memory of a worker, MB."""
    main_peak: float = 0.0
    """Of the main process, MB."""


def main() -> None:
    """Measures and records."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=480, help="of each of 2 cameras")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--made", type=int, default=24, help="pictures with made masks")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    tables = [given_masks(arguments.frames, arguments.repeats), made_masks(arguments.made)]
    record("prepare", "From raw pictures to prepared files", SEED, tables)


def given_masks(frames: int, repeats: int) -> Table:
    """Preparation of ZJU-MoCap pictures with 1 and 2 workers, and its unavoidable part."""
    folder = long_zju_sequence(frames)
    source = open_zju(find_zju(folder)[0], OpenOptions(body_model=BODY, pairs="all"))
    count = int(source.wanted.sum())
    in_process(prepared, source, 1)  # fills the page cache, and leaves the file for `alone`
    runs: dict[str, list[Run]] = {name: [] for name in (WHOLE, CROP, *PREPARE.values())}
    for _ in range(repeats):
        for name, cropped in ((WHOLE, False), (CROP, True)):
            runs[name].append(in_process(alone, source, cropped))
        for workers, name in PREPARE.items():
            runs[name].append(in_process(prepared, source, workers))
    rows = [_bare_row(runs[name], name, count) for name in (WHOLE, CROP)]
    rows += [_prepare_row(runs, workers, count) for workers in PREPARE]
    start = statistics.median(run.start for run in runs[PREPARE[2]])
    return Table(
        f"Given masks: {count} pictures of 1024 x 1024 with two masks each",
        (
            "what",
            "pictures/s",
            "ms per picture",
            "CPU ms per picture",
            "times 1 worker",
            "share of the bare work, CPU time",
            "of that on the crop, CPU time",
            "share of the bare work per worker, by the clock",
            "worker peak, MB",
            "main process peak, MB",
        ),
        tuple(rows),
        "Aims: 2 workers at least 1.7 times 1 worker; share at least 0.8; less than 1000 MB per "
        "worker. Shares are medians over runs that follow each other. OpenCV has one thread per "
        f"process. Starting two processes takes {start:.1f} s once per run and is not counted. The "
        "bare work is: read, decode picture and masks, undistort both whole, compress the finished "
        "crop; without finding the person, hashing the sources, resizing, writing, and the digests "
        "of the file. `prepare` undistorts only what the crop needs, with maps made once per "
        "camera; the second line does so too (the crop exactly, which only the finished file "
        "tells). The 60 different pictures of each camera are repeated.",
    )


def _bare_row(runs: Sequence[Run], name: str, count: int) -> Row:
    wall, cpu = (statistics.median(getattr(run, kind) for run in runs) for kind in ("wall", "cpu"))
    return (name, count / wall, 1000 * wall / count, 1000 * cpu / count, "", "", "", "", "", "")


def _prepare_row(runs: Mapping[str, Sequence[Run]], workers: int, count: int) -> Row:
    mine, single = runs[PREPARE[workers]], runs[PREPARE[1]]
    wall, cpu = (statistics.median(getattr(run, kind) for run in mine) for kind in ("wall", "cpu"))
    by_clock = _share(runs[WHOLE], mine, "wall") / workers
    return (
        PREPARE[workers],
        count / wall,
        1000 * wall / count,
        1000 * cpu / count,
        f"{_share(single, mine, 'wall'):.2f}",
        f"{_share(runs[WHOLE], mine, 'cpu'):.2f}",
        f"{_share(runs[CROP], mine, 'cpu'):.2f}",
        f"{by_clock:.2f}",
        max(run.worker_peak for run in mine) if workers > 1 else "",
        max(run.main_peak for run in mine),
    )


def _share(base: Sequence[Run], runs: Sequence[Run], kind: Literal["wall", "cpu"]) -> float:
    """What the base takes over what the runs take, each compared with its neighbour in time."""
    return statistics.median(
        getattr(one, kind) / getattr(other, kind) for one, other in zip(base, runs, strict=True)
    )


def prepared(source: SourceSequence, workers: int) -> Run:
    """One whole preparation of a sequence."""
    out = fresh(OUT, lambda _: None)
    laps: list[float] = []
    with team(workers) as executor:
        with stopwatch(laps):
            if executor is not None:
                list(executor.map(time.sleep, [0.5] * workers))
        before = _cpu_seconds()
        with stopwatch(laps):
            prepare_sequence(source, out, PrepareOptions(workers=workers), executor)
        cpu = _cpu_seconds() - before
        peaks = [_peak(child.pid) for child in multiprocessing.active_children()]
    return Run(laps[1], cpu, laps[0], max(peaks, default=0.0), _peak(None))


def alone(source: SourceSequence, cropped: bool) -> Run:
    """What no preparation can leave out, for all pictures, in this process.

    Args:
        source: the sequence, prepared before.
        cropped: undistort only what becomes the finished crop.
    """
    cv2.setNumThreads(1)
    reader = source.reader
    assert isinstance(reader, ImageReader)
    finished = _finished(source)
    period = len(finished) // len(source.cameras)
    before, started = _cpu_seconds(), time.perf_counter()
    for camera, frame in np.argwhere(source.wanted).tolist():
        if frame == 0:
            lens = lens_of(source.cameras[camera])
            whole = Crop(0, 0, *lens.camera.size)
        crop = finished[camera, frame % period]
        window = _source_window(crop, lens.camera.size) if cropped else whole
        image, *masks = (path.read_bytes() for path in reader.files(camera, frame))
        picture = np.asarray(cv2.imdecode(np.frombuffer(image, np.uint8), READ_FLAGS), np.uint8)
        decoded = [cv2.imdecode(np.frombuffer(m, np.uint8), cv2.IMREAD_UNCHANGED) for m in masks]
        undistorted(lens, picture, window)
        undistorted(lens, np.maximum.reduce(decoded).astype(np.uint8), window)
        encode_picture(crop)
    return Run(time.perf_counter() - started, _cpu_seconds() - before)


def _finished(source: SourceSequence) -> dict[tuple[int, int], Picture]:
    """The prepared pictures of the different frames."""
    frames = range(min(ZJU.frames, len(source.frames)))
    with SequenceFile(OUT / f"{source.found.name}.h5") as file:
        return {
            (camera, frame): file.picture(camera, frame)
            for camera in range(len(source.cameras))
            for frame in frames
        }


def _source_window(picture: Picture, size: tuple[int, int]) -> Crop:
    """The source pixels of a stored crop, half the source's size, inside the picture."""
    left, top = (max(0, 2 * offset) for offset in picture.offset)
    height, width = picture.alpha.shape
    right = min(size[0], 2 * (picture.offset[0] + width))
    bottom = min(size[1], 2 * (picture.offset[1] + height))
    return Crop(left, top, right - left, bottom - top)


def made_masks(count: int) -> Table:
    """Seconds per picture of AIST++ video with masks that are made here."""
    root = aist_root()
    source = open_aist(find_aist(root)[0], OpenOptions(body_model=BODY))
    reader = source.reader
    assert isinstance(reader, AistReader)
    frames = list(range(0, len(source.frames), max(1, 2 * len(source.frames) // count)))
    laps: dict[str, list[Run]] = {"background": [], "silhouette": [], "mask": [], "all": []}
    for camera in range(len(source.cameras)):
        with _lap(laps["background"]):
            stage = reader.background(camera)
        with _lap(laps["all"], len(frames)):
            pictures = list(reader.read_many(camera, frames))
        view = reader._views[camera]
        for frame, picture in zip(frames, pictures, strict=True):
            with _lap(laps["silhouette"]):
                body = reader._scene.silhouette(view, frame)
            with _lap(laps["mask"]):
                make_mask(picture.image, stage, body)
    step = source.frames[1] - source.frames[0]
    meanings = {
        "background": "the empty stage, once per view",
        "silhouette": "silhouette of the fitted body, per picture",
        "mask": "mask, per picture",
        "all": f"all, per picture (video decoding too, {step} video pictures per prepared one)",
    }
    rows = tuple(
        (
            meaning,
            statistics.median(lap.wall for lap in laps[name]),
            statistics.median(lap.cpu for lap in laps[name]),
        )
        for name, meaning in meanings.items()
    )
    width, height = source.cameras[0].size
    return Table(f"Made masks: video of {width} x {height}", ("what", "s", "CPU s"), rows)


@contextmanager
def _lap(laps: list[Run], count: int = 1) -> Iterator[None]:
    """Appends the times of its context, over a number of pictures, in this process."""
    wall, cpu = time.perf_counter(), time.process_time()
    yield
    laps.append(Run((time.perf_counter() - wall) / count, (time.process_time() - cpu) / count))


def in_process(function: Callable[..., Result], *arguments: object) -> Result:
    """The result of a function in a fresh process, so that memory peaks are its own."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(sender, function, arguments))
    process.start()
    result: Result = receiver.recv()
    process.join()
    return result


def _answer(
    sender: Connection, function: Callable[..., object], arguments: tuple[object, ...]
) -> None:
    sender.send(function(*arguments))


def _cpu_seconds() -> float:
    """CPU time so far of this process and its living children."""
    ticks = os.sysconf("SC_CLK_TCK")
    total = time.process_time()
    for child in multiprocessing.active_children():
        fields = Path(f"/proc/{child.pid}/stat").read_text().rpartition(")")[2].split()
        total += (int(fields[11]) + int(fields[12])) / ticks
    return total


def _peak(pid: int | None) -> float:
    """Largest resident memory of a process so far, MB."""
    status = Path(f"/proc/{pid or 'self'}/status").read_text()
    line = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024 / 1e6


if __name__ == "__main__":
    main()
