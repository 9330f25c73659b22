import sys

import pytest

from actorsnerf_train.allocator import keep_memory


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc is a library of Linux")
def test_glibc_takes_the_settings() -> None:
    assert keep_memory() is True


def test_other_systems_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    assert keep_memory() is False


def test_another_c_library_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("actorsnerf_train.allocator.ctypes.util.find_library", lambda name: None)
    assert keep_memory() is False
