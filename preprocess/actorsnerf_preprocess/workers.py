"""Work spread over processes: the job they share, and results in the order of the tasks.

The job (source, options) is written once as a file beside the output; tasks name it by its digest,
so that local processes and those of a cluster with the same file system read it once each.
"""

import hashlib
import multiprocessing
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import cv2

from actorsnerf_datasets.types import Camera
from actorsnerf_preprocess.pictures import Lens, PictureOptions, lens_of, stored_camera
from actorsnerf_preprocess.process_team import ProcessTeam
from actorsnerf_preprocess.source import SourceError, SourceSequence

Task = TypeVar("Task")
Result = TypeVar("Result")
TASKS_AHEAD = 3
"""Tasks per worker that are handed out before their results are needed."""


@dataclass(frozen=True)
class Job:
    """What all tasks of one sequence share."""

    source: SourceSequence
    options: PictureOptions


@dataclass(frozen=True)
class JobFile:
    """Where the job is; the digest keeps a worker from running another one."""

    path: Path
    digest: str

    def stage(self, camera: int) -> Path:
        """Where the processes share a camera's empty stage; deleted with the job."""
        return self.path.with_name(f"{self.path.name}.stage{camera}.npz")


@dataclass(frozen=True)
class PictureTask:
    """Pictures of one camera."""

    job: JobFile
    camera: int
    frames: tuple[int, ...]
    """Indices, ascending."""


@contextmanager
def job_file(path: Path, job: Job) -> Iterator[JobFile]:
    """The job as a file, which is deleted on the way out, with the stages beside it."""
    content = pickle.dumps(job, protocol=pickle.HIGHEST_PROTOCOL)
    file = JobFile(path, hashlib.sha256(content).hexdigest())
    stages = [file.stage(camera) for camera in range(len(job.source.cameras))]
    try:
        for stage in stages:  # a killed run leaves them
            stage.unlink(missing_ok=True)
        _write(path, content)
        yield file
    finally:
        for left in (path, *stages):
            left.unlink(missing_ok=True)


@lru_cache(maxsize=1)
def load_job(file: JobFile) -> Job:
    """The job of a task; read once per process."""
    content = file.path.read_bytes()
    if hashlib.sha256(content).hexdigest() != file.digest:
        raise SourceError(f"{file.path}: was changed while a preparation was running.")
    job = pickle.loads(content)
    assert isinstance(job, Job)
    return job


@lru_cache(maxsize=4)
def load_lens(file: JobFile, camera: int) -> tuple[Lens, Camera]:
    """The undistortion of a camera of the job, and the camera of its stored pictures."""
    job = load_job(file)
    source_camera = job.source.cameras[camera]
    return lens_of(source_camera), stored_camera(source_camera, job.options.scale)


@contextmanager
def team(workers: int) -> Iterator[Executor | None]:
    """Worker processes; None for one worker, which is this process."""
    cv2.setNumThreads(1)
    if workers <= 1:
        yield None
        return
    executor = ProcessTeam(workers, _start_worker)
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)


def in_order(
    executor: Executor | None,
    function: Callable[[Task], Result],
    tasks: Iterable[Task],
    ahead: int,
) -> Iterator[Result]:
    """The results in the order of the tasks; at most `ahead` tasks are under way.

    Raises:
        SourceError: a worker process was killed.
    """
    if executor is None:
        yield from map(function, tasks)
        return
    try:
        yield from _results(executor, function, tasks, ahead)
    except BrokenExecutor as error:
        raise SourceError(
            "A worker process was killed, perhaps because memory ran out; finished files are kept: "
            "run the same command again, with fewer --workers."
        ) from error


def _results(
    executor: Executor,
    function: Callable[[Task], Result],
    tasks: Iterable[Task],
    ahead: int,
) -> Iterator[Result]:
    waiting: deque[Future[Result]] = deque()
    for task in tasks:
        waiting.append(executor.submit(function, task))
        if len(waiting) >= ahead:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def _write(path: Path, content: bytes) -> None:
    try:
        path.write_bytes(content)
    except OSError as error:
        raise SourceError(f"{path}: could not be written ({error}): is the disk full?") from error


def _start_worker() -> None:
    """One OpenCV thread; Ctrl-C is the parent's business; the end of the parent is the end."""
    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A killed parent cannot stop its workers, and they would wait for tasks for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
