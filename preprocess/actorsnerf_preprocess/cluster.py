"""Workers on several machines: `dask.distributed` through its `concurrent.futures` interface.

The output folder must be on a file system that all machines see, and so must the source.
"""

import importlib
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from actorsnerf_preprocess.source import SourceError


@contextmanager
def cluster_team(address: str) -> Iterator[Executor]:
    """The workers of a running scheduler, for the time of the context.

    Args:
        address: such as `tcp://host:8786`.

    Raises:
        SourceError: dask.distributed is not installed, or no scheduler answers.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise SourceError(
            "--scheduler needs dask.distributed: pip install '.[cluster]', here and on the workers."
        ) from error
    try:
        client = distributed.Client(address, timeout="20s")
    except (OSError, ValueError, TimeoutError) as error:
        raise SourceError(f"{address}: no dask scheduler answers there ({error}).") from error
    try:
        yield client.get_executor(pure=False)
    finally:
        client.close()
