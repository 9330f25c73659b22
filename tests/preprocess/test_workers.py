import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import pytest

from actorsnerf_preprocess.pictures import PictureOptions
from actorsnerf_preprocess.source import OpenOptions, SourceError
from actorsnerf_preprocess.workers import (
    Job,
    JobFile,
    in_order,
    job_file,
    load_job,
    load_lens,
    team,
)
from actorsnerf_preprocess.zju import find_zju, open_zju

WriteTree = Callable[..., Any]


def slow_square(number: int) -> int:
    time.sleep(0.02 * (3 - number % 3))
    return number * number


def process_and_threads(_: int) -> tuple[int, int]:
    return os.getpid(), cv2.getNumThreads()


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_tasks(workers: int) -> None:
    with team(workers) as executor:
        assert list(in_order(executor, abs, range(-7, 0), ahead=3)) == [7, 6, 5, 4, 3, 2, 1]


def test_no_more_tasks_are_taken_than_asked_for() -> None:
    taken: list[int] = []

    def tasks() -> Any:
        for number in range(100):
            taken.append(number)
            yield -number

    with team(2) as executor:
        results = in_order(executor, abs, tasks(), ahead=4)
        assert next(results) == 0
        assert len(taken) == 4
        results.close()  # type: ignore[attr-defined]


def die(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_killed_worker_is_a_sentence() -> None:
    with team(2) as executor, pytest.raises(SourceError, match="A worker process was killed"):
        list(in_order(executor, die, range(4), 4))


def test_one_worker_is_this_process() -> None:
    with team(1) as executor:
        assert executor is None
        assert list(in_order(executor, process_and_threads, [0], 1)) == [(os.getpid(), 1)]


def test_a_job_is_read_back_and_its_file_deleted(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    write_zju(tmp_path / "CoreView_377", frames=range(1), cameras=1)
    source = open_zju(find_zju(tmp_path)[0], OpenOptions(body_model=tiny_body))
    job = Job(source, PictureOptions(scale=0.25))
    with job_file(tmp_path / "job", job) as file:
        assert load_job(file).options == job.options
        lens, stored = load_lens(file, 0)
        assert lens.camera.name == "Camera_B1"
        assert stored.size == (40, 40)
        (tmp_path / "job").write_bytes(b"something else")
        with pytest.raises(SourceError, match="was changed while a preparation was running"):
            load_job(JobFile(file.path, "0" * 64))
    assert not (tmp_path / "job").exists()


def test_a_job_that_cannot_be_written_is_a_sentence(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    write_zju(tmp_path / "CoreView_377", frames=range(1), cameras=1)
    source = open_zju(find_zju(tmp_path)[0], OpenOptions(body_model=tiny_body))
    job = Job(source, PictureOptions())
    with (
        pytest.raises(SourceError, match="could not be written"),
        job_file(tmp_path / "gone" / "job", job),
    ):
        pass
