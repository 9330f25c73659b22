import errno
import subprocess
import sys
from pathlib import Path

import pytest

from actorsnerf_datasets import file_lock
from actorsnerf_datasets.file_lock import (
    FileInUseError,
    held,
    open_locked,
    remove_locked,
    rename_locked,
)

needs_locks = pytest.mark.skipif(sys.platform == "win32", reason="needs flock")


def test_a_missing_file_is_made_and_an_existing_one_kept(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with open_locked(path) as file:
        file.write(b"whole")
    with open_locked(path) as file:
        assert file.read() == b"whole"
    with pytest.raises(FileNotFoundError):
        open_locked(tmp_path / "gone" / "a")


@needs_locks
def test_a_second_writer_is_refused_until_the_first_closes(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with open_locked(path), pytest.raises(FileInUseError, match="another process writes it"):
        open_locked(path)
    open_locked(path).close()


@needs_locks
def test_a_killed_process_leaves_its_file_and_no_lock(tmp_path: Path) -> None:
    path = tmp_path / "a"
    code = (
        "import sys; from pathlib import Path; from actorsnerf_datasets.file_lock import held\n"
        "with held(Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        with pytest.raises(FileInUseError), held(path):
            pass
        process.kill()
    assert path.exists()
    with held(path):
        pass
    assert not path.exists()


@needs_locks
def test_a_file_renamed_before_it_is_locked_is_opened_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, finished, lock = tmp_path / "a.part", tmp_path / "a", file_lock._lock
    path.write_bytes(b"whole")

    def late(*arguments: object) -> None:
        if not finished.exists():
            path.rename(finished)
        lock(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(file_lock, "_lock", late)
    with open_locked(path) as file:
        file.write(b"another")
    assert (finished.read_bytes(), path.read_bytes()) == (b"whole", b"another")


def test_a_renamed_file_is_not_removed_nor_another_of_its_name(tmp_path: Path) -> None:
    path, finished = tmp_path / "a.part", tmp_path / "a"
    with open_locked(path) as file:
        file.write(b"whole")
        rename_locked(file, path, finished)
        with open_locked(path) as another:
            remove_locked(file, path)
            assert path.exists()
            remove_locked(another, path)
            assert not path.exists()
    assert finished.read_bytes() == b"whole"


def test_without_locks_files_are_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(file_lock, "fcntl", None)
    path, finished = tmp_path / "a.part", tmp_path / "a"
    with held(path), held(path):
        assert not path.exists()
    with open_locked(path) as file, open_locked(path):
        file.write(b"whole")
        rename_locked(file, path, finished)
        assert file.closed  # Windows would refuse otherwise
    with open_locked(path) as file:
        remove_locked(file, path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["a"]


@needs_locks
@pytest.mark.parametrize(("code", "works"), [(errno.ENOSYS, True), (errno.EIO, False)])
def test_a_file_system_without_locks_is_not_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, works: bool
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(code, "refused")

    monkeypatch.setattr("fcntl.flock", refuse)
    if works:
        open_locked(tmp_path / "a").close()
    else:
        with pytest.raises(OSError, match="refused"):
            open_locked(tmp_path / "a")
