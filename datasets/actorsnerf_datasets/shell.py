"""Paths in the commands that a message tells the user to run."""

import shlex
from pathlib import Path


def quoted(path: Path) -> str:
    """The path as a shell reads it back, whatever characters it has.

    >>> print(quoted(Path("my data/eve.h5")), quoted(Path("eve.h5")))
    'my data/eve.h5' eve.h5
    """
    return shlex.quote(str(path))
