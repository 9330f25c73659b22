"""A full disk, a killed process, Ctrl-C: nothing half-written, and the next run is as the first.

What these tests record goes into `benchmarks/results/faults.md`; see `scripts/fault_table.py`.
"""

import errno
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from actorsnerf_datasets import output_file
from actorsnerf_datasets.check import check_sequence
from actorsnerf_preprocess import run_report
from actorsnerf_preprocess.__main__ import main

PATIENCE = 300.0
"""Seconds; what is waited for takes two or three, and longer only on a machine that is busy."""

Record = Callable[[str, object], None]


def arguments(scene: Any, workers: int) -> list[str]:
    parts = ["prepare", "--source", scene.source, "--out", scene.out, "--all-pairs"]
    return [str(part) for part in (*parts, "--workers", workers, "--body-model", scene.body)]


@contextmanager
def running(scene: Any, workers: int) -> Iterator[subprocess.Popen[str]]:
    """The command line as a process of its own, ended with the context."""
    command = [sys.executable, "-m", "actorsnerf_preprocess", *arguments(scene, workers)]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Tests that a shell runs in its background ignore interrupts, and so would their children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_until(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.02)


def stuck(scene: Any) -> bytes:
    """Makes one picture a pipe that nobody writes to; returns the picture's bytes."""
    path = scene.picture(2, 3)
    content: bytes = path.read_bytes()
    path.unlink()
    os.mkfifo(path)
    return content


@contextmanager
def second_pass_waiting(scene: Any, content: bytes) -> Iterator[None]:
    """The first pass over the pictures gets the picture; the second one waits for it.

    It waits for as long as the context: the pipe has somebody who writes to it, and does not.
    """
    scene.picture(2, 3).write_bytes(content)
    wait_until((scene.out / "CoreView_377.h5.part").exists)
    pipe: list[int] = []

    def asked_for() -> bool:
        try:
            pipe.append(os.open(scene.picture(2, 3), os.O_WRONLY | os.O_NONBLOCK))
        except OSError as error:
            assert error.errno == errno.ENXIO, "nobody reads it yet"
        return bool(pipe)

    wait_until(asked_for)
    try:
        yield
    finally:
        os.close(pipe[0])


def worker_processes(process: subprocess.Popen[str]) -> list[int]:
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(pid) for pid in children if b"spawn_main" in _command_line(int(pid))]


def waiting_worker(process: subprocess.Popen[str], scene: Any) -> int:
    """The worker that has the pipe open."""
    found: list[int] = []

    def opened() -> bool:
        for pid in worker_processes(process):
            files = [link.readlink() for link in Path(f"/proc/{pid}/fd").iterdir()]
            found.extend([pid] * (scene.picture(2, 3) in files))
        return bool(found)

    wait_until(opened)
    return found[0]


def _command_line(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def finished_names(scene: Any) -> list[str]:
    return sorted(path.name for path in scene.out.glob("*") if path.suffix != ".part")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes and /proc")
def test_killed_at_work(scene: Any, tmp_path: Path, record_property: Record) -> None:
    assert main(arguments(scene, 1)) == 0
    whole = (scene.out / "CoreView_377.h5").read_bytes()
    for path in scene.out.iterdir():
        path.unlink()
    content = stuck(scene)
    with running(scene, 2) as process, second_pass_waiting(scene, content):
        workers = worker_processes(process)
        assert len(workers) == 2
        process.kill()
    assert finished_names(scene) == []
    wait_until(lambda: not any(b"spawn_main" in _command_line(pid) for pid in workers))
    scene.picture(2, 3).unlink()
    scene.picture(2, 3).write_bytes(content)
    assert main(arguments(scene, 1)) == 0
    assert (scene.out / "CoreView_377.h5").read_bytes() == whole
    assert finished_names(scene) == [f"CoreView_377.{kind}" for kind in ("h5", "json", "png")]
    assert list(scene.out.glob("*.part")) == []
    record_property("fault", "run killed (SIGKILL) while it writes, and started again")
    record_property("reads", "(nothing; the second run's file is byte-identical to a whole run's)")
    record_property("outcome", "nothing half-written")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes and /proc")
def test_a_killed_worker(scene: Any, record_property: Record) -> None:
    content = stuck(scene)
    with running(scene, 2) as process, second_pass_waiting(scene, content):
        os.kill(waiting_worker(process, scene), signal.SIGKILL)
        _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    (line,) = errors.splitlines()
    assert line.startswith("error: A worker process was killed, perhaps because memory ran out;")
    assert finished_names(scene) == []
    record_property("fault", "worker process killed (out of memory)")
    record_property("reads", line)
    record_property("outcome", "refused")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_interrupted(scene: Any, record_property: Record) -> None:
    content = stuck(scene)
    with running(scene, 1) as process:
        with second_pass_waiting(scene, content):
            process.send_signal(signal.SIGINT)
        # A signal between the opening of the pipe and the reading from it is noticed only when
        # the reading ends, so the pipe is closed before the end is waited for.
        _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert errors == "interrupted: run the same command again to go on\n"
    assert list(scene.out.iterdir()) == []
    record_property("fault", "run interrupted (Ctrl-C)")
    record_property("reads", errors.strip())
    record_property("outcome", "refused (exit 130)")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_started_twice(scene: Any, record_property: Record) -> None:
    content = stuck(scene)
    with running(scene, 2) as process:
        with second_pass_waiting(scene, content):
            before = sorted(path.name for path in scene.out.iterdir())
            with running(scene, 1) as second:
                _, errors = second.communicate(timeout=PATIENCE)
            assert second.returncode == 2
            (line,) = errors.splitlines()
            assert sorted(path.name for path in scene.out.iterdir()) == before
            scene.picture(2, 3).write_bytes(content)
        _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (0, "")
    assert "CoreView_377.h5: another preparation is writing it: wait for it or stop it" in line
    names = [f"CoreView_377.{kind}" for kind in ("h5", "json", "png")]
    assert sorted(path.name for path in scene.out.iterdir()) == names
    found = check_sequence(scene.out / "CoreView_377.h5", scene.body)
    assert [one for one in found if one.severity == "error"] == []
    record_property("fault", "the same command started twice at once")
    record_property("reads", line.replace(f"{scene.home}/", ""))
    record_property("outcome", "refused")


@pytest.mark.parametrize("limit", [3_000, 80_000], ids=["job", "pictures"])
def test_no_room_for_files(scene: Any, limit: int, record_property: Record) -> None:
    """A limit on file sizes makes writes fail in the way a full disk does."""
    command = [sys.executable, "-m", "actorsnerf_preprocess", *arguments(scene, 1)]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert "could not be written" in line
    assert "is the disk full" in line
    assert list(scene.out.iterdir()) == []
    record_property("fault", f"no room on the disk after {limit} bytes")
    record_property("reads", line.replace(f"{scene.home}/", ""))
    record_property("outcome", "refused")


@pytest.mark.parametrize(
    ("module", "what"), [(output_file, "h5"), (run_report, "json")], ids=["file", "report"]
)
def test_disk_full_at_the_end(
    scene: Any,
    module: Any,
    what: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    record_property: Record,
) -> None:
    class Full:
        """What `os` is where the disk is full."""

        def __getattr__(self, name: str) -> Any:
            return getattr(os, name)

        def fsync(self, _: int) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(module, "os", Full())
        assert main(arguments(scene, 1)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"CoreView_377.{what}: could not be written ([Errno 28] No space left on" in line
    left = {"h5": [], "json": ["CoreView_377.h5", "CoreView_377.png"]}[what]
    assert sorted(path.name for path in scene.out.iterdir()) == left
    assert main(arguments(scene, 1)) == 0
    assert finished_names(scene) == [f"CoreView_377.{kind}" for kind in ("h5", "json", "png")]
    record_property("fault", f"disk full when the {what} file is synchronised")
    record_property("reads", line.replace(f"{scene.home}/", ""))
    record_property("outcome", "refused")
