import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from actorsnerf_preprocess.cluster import cluster_team
from actorsnerf_preprocess.source import SourceError

PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"


class FakeClient:
    closed = False

    def __init__(self, address: str, timeout: str) -> None:
        if address == "tcp://nowhere:1":
            raise OSError("no route")

    def get_executor(self, pure: bool) -> ThreadPoolExecutor:
        assert not pure
        return ThreadPoolExecutor(1)

    def close(self) -> None:
        FakeClient.closed = True


@pytest.fixture
def distributed(monkeypatch: pytest.MonkeyPatch) -> None:
    module: Any = ModuleType("distributed")
    module.Client = FakeClient
    monkeypatch.setitem(sys.modules, "distributed", module)


@pytest.mark.usefixtures("distributed")
def test_the_schedulers_executor_runs_the_work_and_is_closed() -> None:
    with cluster_team("tcp://here:8786") as executor:
        assert executor.submit(abs, -3).result() == 3
    assert FakeClient.closed


@pytest.mark.usefixtures("distributed")
def test_a_silent_scheduler_is_a_sentence() -> None:
    message = r"tcp://nowhere:1: no dask scheduler answers.*no route"
    with pytest.raises(SourceError, match=message), cluster_team("tcp://nowhere:1"):
        pass


def test_without_dask_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    message = r"--scheduler needs dask\.distributed: pip install '\.\[cluster\]', here and on"
    with pytest.raises(SourceError, match=message), cluster_team("tcp://here:8786"):
        pass


def test_the_extra_that_the_sentence_names_has_dask() -> None:
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    extra = project["optional-dependencies"]["cluster"]
    assert any(requirement.startswith("distributed") for requirement in extra)
