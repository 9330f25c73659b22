import shlex
from pathlib import Path

import pytest

from actorsnerf_datasets.shell import quoted


@pytest.mark.parametrize("name", ["eve.h5", "my data/eve's.h5", "$HOME/a;b.h5"])
def test_a_shell_reads_the_same_path(name: str) -> None:
    assert shlex.split(f"check {quoted(Path(name))}") == ["check", name]
