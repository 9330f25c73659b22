"""A file that HDF5 writes to and that never fails under it."""

import os
from pathlib import Path
from types import TracebackType
from typing import Any

from actorsnerf_datasets.file_lock import open_locked, remove_locked, rename_locked


class OutputFile:
    """A new file whose first write error is kept, and raised when asked for.

    It is locked until it is closed: no other process can write it.

    HDF5 cannot close a file whose writes fail: on a full disk it prints tracebacks and may crash
    the process. Here a failed write is remembered, later ones are dropped, and `raise_failure`
    says so in a place where it can be handled.
    """

    def __init__(self, path: Path) -> None:
        """Create the file, or empty it.

        Raises:
            FileInUseError: another process is writing it.
            OSError: it cannot be created.
        """
        self._path = path
        self._file = open_locked(path)
        self._failure: OSError | None = None
        self.truncate(0)

    def __enter__(self) -> "OutputFile":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def raise_failure(self) -> None:
        """Nothing, if all writes so far succeeded.

        Raises:
            OSError: the first one that did not.
        """
        if self._failure is not None:
            raise self._failure

    def synchronise(self) -> None:
        """Waits until all is on the disk.

        Raises:
            OSError: something is not.
        """
        self.raise_failure()
        os.fsync(self._file.fileno())

    def rename(self, target: Path) -> None:
        """Gives the file its final name; nothing may be written any more.

        Raises:
            OSError: it cannot be renamed.
        """
        rename_locked(self._file, self._path, target)

    def remove(self) -> None:
        """Removes the file, unless it was renamed.

        Raises:
            OSError: it cannot be removed.
        """
        remove_locked(self._file, self._path)

    def read(self, size: int) -> bytes:
        """As many bytes; what was dropped reads as zeros."""
        buffer = bytearray(size)
        self.readinto(buffer)
        return bytes(buffer)

    def readinto(self, buffer: Any) -> int:
        """How many bytes were read into a writable buffer; what was dropped reads as zeros."""
        view = memoryview(buffer).cast("B")
        found = self._file.readinto(view) or 0
        view[found:] = bytes(len(view) - found)
        return len(view)

    def write(self, content: Any) -> int:
        """The length of a buffer, written or dropped."""
        rest = memoryview(content).cast("B")
        length = len(rest)
        try:
            while self._failure is None and len(rest):
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._failure = error
        return length

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """The new position."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """The position."""
        return self._file.tell()

    def truncate(self, size: int | None = None) -> int:
        """The size asked for; a failure is kept."""
        wanted = self._file.tell() if size is None else size
        try:
            if self._failure is None:
                self._file.truncate(wanted)
        except OSError as error:
            self._failure = error
        return wanted

    def flush(self) -> None:
        """Nothing: there is no buffer."""

    def close(self) -> None:
        """Closes the file; a failure is kept."""
        try:
            self._file.close()
        except OSError as error:
            self._failure = self._failure or error
