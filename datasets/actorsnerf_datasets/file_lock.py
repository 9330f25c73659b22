"""A file that one process at a time writes: locked from its opening until it is closed.

The lock is the kernel's (`flock`), so a killed process leaves none. Where there is no such lock
(Windows, some network file systems), files are opened without one.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_HELD = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES}
_NO_LOCKS = {errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL}


class FileInUseError(OSError):
    """Another process writes the file."""


def open_locked(path: Path) -> FileIO:
    """The file, open to read and write; made if it is not there, its content kept if it is.

    Raises:
        FileInUseError: another process has it open in this way.
        OSError: it cannot be made.
    """
    while True:
        file = FileIO(path, "r+", opener=_made)
        try:
            _lock(file, path)
            if _is_at(file, path):
                return file
        except BaseException:
            file.close()
            raise
        file.close()  # between opening and locking, its holder renamed or removed it


def rename_locked(file: FileIO, path: Path, target: Path) -> None:
    """Gives an open file its final name, before another process can lock it.

    Raises:
        OSError: it cannot be renamed.
    """
    if fcntl is None:  # Windows renames no open file
        file.close()
    path.replace(target)


def remove_locked(file: FileIO, path: Path) -> None:
    """Removes an open file, unless its name is another file's by now.

    Raises:
        OSError: it cannot be removed.
    """
    if fcntl is None:  # Windows removes no open file
        file.close()
    elif not _is_at(file, path):
        return
    path.unlink(missing_ok=True)


@contextmanager
def held(path: Path) -> Iterator[None]:
    """A lock file that is there as long as the context; nothing where there are no locks.

    Raises:
        FileInUseError: another process holds it.
        OSError: it cannot be made.
    """
    if fcntl is None:
        yield
        return
    with open_locked(path) as file:
        try:
            yield
        finally:
            remove_locked(file, path)


def _made(path: str | Path, flags: int) -> int:
    return os.open(path, flags | os.O_CREAT, 0o666)


def _lock(file: FileIO, path: Path) -> None:
    if fcntl is None:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _HELD:
            raise FileInUseError(error.errno, "another process writes it", str(path)) from error
        if error.errno not in _NO_LOCKS:
            raise


def _is_at(file: FileIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False
