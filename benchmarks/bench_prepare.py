"""How fast raw pictures become a prepared file, against what cannot be avoided, and in what memory.

Given masks: with 1 and 2 workers, against decoding, undistorting and compressing alone, by the same
process in the same run. Made masks have their own seconds per picture.
"""

import argparse
import multiprocessing
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from records import Table, record, stopwatch
from scenes import BODY, HOME, SEED, aist_root, fresh, long_zju_sequence

from actorsnerf_datasets.reader import SequenceFile
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

WORKERS = (1, 2)
OUT = HOME / "prepared"


@dataclass(frozen=True)
class Run:
    """One preparation."""

    seconds: float
    """Of the pictures: processes are running already, as in a run over many sequences."""
    start: float
    """Seconds until all worker processes are ready."""
    worker_peak: float
    """Largest resident memory of a worker, MB."""
    main_peak: float
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
    runs: dict[int, list[Run]] = {workers: [] for workers in WORKERS}
    alone_seconds: list[float] = []
    for _ in range(repeats):
        alone_seconds.append(in_process(alone, source))
        for workers in WORKERS:
            runs[workers].append(in_process(prepared, source, workers))
    bare = statistics.median(alone_seconds)
    rows: list[tuple[str | float | int, ...]] = [
        ("decode, undistort, compress alone", count / bare, 1000 * bare / count, "", "", "", "")
    ]
    single = statistics.median(run.seconds for run in runs[1])
    for workers in WORKERS:
        seconds = statistics.median(run.seconds for run in runs[workers])
        rows.append(
            (
                f"prepare, {workers} worker{'s' if workers > 1 else ''}",
                count / seconds,
                1000 * seconds / count,
                f"{single / seconds:.2f}",
                f"{bare / seconds / workers:.2f}",
                max(run.worker_peak for run in runs[workers]) if workers > 1 else "",
                max(run.main_peak for run in runs[workers]),
            )
        )
    start = statistics.median(run.start for run in runs[2])
    return Table(
        f"Given masks: {count} pictures of 1024 x 1024 with two masks each",
        (
            "what",
            "pictures/s",
            "ms per picture",
            "times 1 worker",
            "share of the bare work per worker",
            "worker peak, MB",
            "main process peak, MB",
        ),
        tuple(rows),
        "Aims: 2 workers at least 1.7 times 1 worker; share at least 0.8; less than 1000 MB per "
        f"worker. OpenCV has one thread per process. Starting two processes takes {start:.1f} s "
        "once per run and is not counted. The bare work is: read, decode picture and masks, "
        "undistort both whole, compress the finished crop; without finding the person, hashing the "
        "sources, resizing, writing, and the digests of the file. The 60 different pictures of "
        "each camera are repeated.",
    )


def prepared(source: SourceSequence, workers: int) -> Run:
    """One whole preparation of a sequence."""
    out = fresh(OUT, lambda _: None)
    laps: list[float] = []
    with team(workers) as executor:
        with stopwatch(laps):
            if executor is not None:
                list(executor.map(time.sleep, [0.5] * workers))
        with stopwatch(laps):
            prepare_sequence(source, out, PrepareOptions(workers=workers), executor)
        peaks = [_peak(child.pid) for child in multiprocessing.active_children()]
    return Run(laps[1], laps[0], max(peaks, default=0.0), _peak(None))


def alone(source: SourceSequence) -> float:
    """Seconds for what no preparation can leave out, for all pictures, in this process."""
    cv2.setNumThreads(1)
    assert isinstance(source.reader, ImageReader)
    with SequenceFile(OUT / f"{source.found.name}.h5") as file:
        finished = [file.picture(0, frame) for frame in range(min(60, len(source.frames)))]
    started = time.perf_counter()
    for camera, frame in np.argwhere(source.wanted).tolist():
        if frame == 0:
            lens = lens_of(source.cameras[camera])
            whole = Crop(0, 0, *source.cameras[camera].size)
        image, *masks = (path.read_bytes() for path in source.reader.files(camera, frame))
        picture = np.asarray(cv2.imdecode(np.frombuffer(image, np.uint8), READ_FLAGS), np.uint8)
        decoded = [cv2.imdecode(np.frombuffer(m, np.uint8), cv2.IMREAD_UNCHANGED) for m in masks]
        undistorted(lens, picture, whole)
        undistorted(lens, np.maximum.reduce(decoded).astype(np.uint8), whole)
        encode_picture(finished[frame % len(finished)])
    return time.perf_counter() - started


def made_masks(count: int) -> Table:
    """Seconds per picture of AIST++ video with masks that are made here."""
    root = aist_root()
    source = open_aist(find_aist(root)[0], OpenOptions(body_model=BODY, pairs="all"))
    reader = source.reader
    assert isinstance(reader, AistReader)
    frames = list(range(0, len(source.frames), max(1, 2 * len(source.frames) // count)))
    laps: dict[str, list[float]] = {"background": [], "silhouette": [], "mask": [], "all": []}
    for camera in range(len(source.cameras)):
        with stopwatch(laps["background"]):
            stage = reader.background(camera)
        started = time.perf_counter()
        pictures = list(reader.read_many(camera, frames))
        laps["all"].append((time.perf_counter() - started) / len(frames))
        view = reader._views[camera]
        for frame, picture in zip(frames, pictures, strict=True):
            with stopwatch(laps["silhouette"]):
                body = reader._scene.silhouette(view, frame)
            with stopwatch(laps["mask"]):
                make_mask(picture.image, stage, body)
    width, height = source.cameras[0].size
    rows = (
        ("the empty stage, once per view and process", statistics.median(laps["background"])),
        ("silhouette of the fitted body, per picture", statistics.median(laps["silhouette"])),
        ("mask, per picture", statistics.median(laps["mask"])),
        (
            f"all, per picture (video decoding too, {source.frames[1] - source.frames[0]} video "
            "pictures per prepared one)",
            statistics.median(laps["all"]),
        ),
    )
    return Table(f"Made masks: video of {width} x {height}", ("what", "s"), rows)


def in_process(function: Callable[..., object], *arguments: object) -> object:
    """The result of a function in a fresh process, so that memory peaks are its own."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(sender, function, arguments))
    process.start()
    result = receiver.recv()
    process.join()
    return result


def _answer(sender: object, function: Callable[..., object], arguments: tuple[object, ...]) -> None:
    sender.send(function(*arguments))


def _peak(pid: int | None) -> float:
    """Largest resident memory of a process so far, MB."""
    status = Path(f"/proc/{pid or 'self'}/status").read_text()
    line = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024 / 1e6


if __name__ == "__main__":
    main()
