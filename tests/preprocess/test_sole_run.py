import sys
from pathlib import Path

import pytest

from actorsnerf_preprocess.sole_run import sole_run
from actorsnerf_preprocess.source import SourceError


@pytest.mark.skipif(sys.platform == "win32", reason="needs flock")
def test_the_second_run_is_refused_until_the_first_ends(tmp_path: Path) -> None:
    path = tmp_path / "a.b.h5"
    with sole_run(path):
        assert [entry.name for entry in tmp_path.iterdir()] == ["a.b.lock.part"]
        with (
            pytest.raises(
                SourceError,
                match=r"a.b.h5: another preparation is writing it: wait for it or stop it",
            ),
            sole_run(path),
        ):
            pass
        with sole_run(tmp_path / "c.h5"):
            pass
    with sole_run(path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_what_happens_inside_is_passed_on(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="inside"), sole_run(tmp_path / "a.h5"):
        raise FileNotFoundError("inside")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="needs flock")
def test_a_missing_folder_is_a_sentence(tmp_path: Path) -> None:
    with (
        pytest.raises(SourceError, match=r"a.h5: could not be written"),
        sole_run(tmp_path / "gone" / "a.h5"),
    ):
        pass
