import gc
import os
import signal
import struct
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from multiprocessing.connection import Connection
from typing import Any

import pytest

from actorsnerf_preprocess.process_team import ProcessTeam
from actorsnerf_preprocess.source import SourceError

KILLED = "a worker process was killed"


def nothing_to_begin() -> None:
    pass


@pytest.fixture
def two() -> Iterator[ProcessTeam]:
    with ProcessTeam(2, nothing_to_begin) as team:
        yield team


def refuse(name: str) -> None:
    raise SourceError(f"{name}: no.")


def sleep_and_tell(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def half_a_result(whole: int) -> None:
    """Dies when some of its result is in the pipe."""
    for pipe in [one for one in gc.get_objects() if isinstance(one, Connection)]:
        os.write(pipe.fileno(), (struct.pack("!i", 1000) + b"half a result")[:whole])
    os.kill(os.getpid(), signal.SIGKILL)


def leave(_: int) -> None:
    raise SystemExit(3)


def function_of_its_own(_: int) -> Callable[[], None]:
    return lambda: None


def test_tasks_are_done_by_other_processes_at_the_same_time(two: ProcessTeam) -> None:
    processes = {one.result() for one in [two.submit(sleep_and_tell, 0.5) for _ in range(4)]}
    assert len(processes) == 2
    assert os.getpid() not in processes


def test_an_error_is_raised_here_and_tells_where_it_was(two: ProcessTeam) -> None:
    with pytest.raises(SourceError) as raised:
        two.submit(refuse, "this").result()
    assert str(raised.value) == "this: no."
    assert "in refuse" in "".join(raised.value.__notes__)
    assert two.submit(abs, -3).result() == 3


def test_a_result_that_cannot_be_sent_is_an_error(two: ProcessTeam) -> None:
    with pytest.raises(Exception, match=r"(?i)pickle"):
        two.submit(function_of_its_own, 0).result()


@pytest.mark.parametrize(
    ("function", "argument"),
    [(half_a_result, 0), (half_a_result, 2), (half_a_result, 4), (half_a_result, 10), (leave, 0)],
)
def test_the_end_of_a_worker_is_noticed(
    function: Callable[[int], None], argument: int, two: ProcessTeam
) -> None:
    with pytest.raises(BrokenExecutor, match=KILLED):
        two.submit(function, argument).result()


def test_a_worker_killed_between_two_tasks(two: ProcessTeam) -> None:
    os.kill(two.submit(sleep_and_tell, 0.0).result(), signal.SIGKILL)
    outcomes: list[Any] = [one.exception() for one in [two.submit(abs, -1) for _ in range(2)]]
    assert any(isinstance(one, BrokenExecutor) for one in outcomes)


def test_with_one_worker_all_end(two: ProcessTeam) -> None:
    long = two.submit(sleep_and_tell, 600.0)
    with pytest.raises(BrokenExecutor, match=KILLED):
        two.submit(leave, 0).result()
    assert isinstance(long.exception(), BrokenExecutor)
    assert isinstance(two.submit(abs, -1).exception(), BrokenExecutor)


def test_what_waits_is_given_up_on_the_way_out() -> None:
    team = ProcessTeam(1, nothing_to_begin)
    futures = [team.submit(sleep_and_tell, 0.3) for _ in range(3)]
    team.shutdown(cancel_futures=True)
    assert futures[-1].cancelled()
    assert futures[0].result() > 0
