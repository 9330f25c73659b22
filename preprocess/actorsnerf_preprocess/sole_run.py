"""One preparation of a sequence at a time: two would write the same unfinished files."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from actorsnerf_datasets.file_lock import FileInUseError, held
from actorsnerf_preprocess.source import SourceError


@contextmanager
def sole_run(path: Path) -> Iterator[None]:
    """Keeps other preparations from a prepared file, its job and its report.

    Beside it lies `<name>.lock.part` as long as the context. A killed run leaves that file, but no
    lock on it.

    Args:
        path: `<out>/<name>.h5`.

    Raises:
        SourceError: another preparation is at it, or the disk refuses.
    """
    with ExitStack() as stack:
        try:
            stack.enter_context(held(path.with_suffix(".lock.part")))
        except FileInUseError as error:
            raise SourceError(
                f"{path}: another preparation is writing it: wait for it or stop it, then run the "
                "same command again."
            ) from error
        except OSError as error:
            raise SourceError(
                f"{path}: could not be written ({error}): is the disk full or the folder read-only?"
            ) from error
        yield
