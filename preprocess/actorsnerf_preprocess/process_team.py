"""Processes that work for one executor; one that is killed is noticed, whatever it was doing.

The workers of the standard library's `ProcessPoolExecutor` share the pipe of their results: if one
is killed with half a result in it, all wait for the other half for ever. Here each process has a
pipe of its own, which ends with it.
"""

import multiprocessing
import traceback
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from typing import Any


@dataclass(frozen=True)
class _Worker:
    process: BaseProcess
    pipe: Connection


@dataclass(frozen=True)
class _Outcome:
    result: Any
    error: Exception | None


class ProcessTeam(Executor):
    """`ProcessPoolExecutor`, but without a common pipe; a thread here waits for each process.

    With one process all end, and every future that is not done raises BrokenExecutor.
    """

    def __init__(self, workers: int, initializer: Callable[[], None]) -> None:
        self._workers = [_start(initializer) for _ in range(workers)]
        self._idle: SimpleQueue[_Worker] = SimpleQueue()
        for worker in self._workers:
            self._idle.put(worker)
        self._threads = ThreadPoolExecutor(workers)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As the interface says; the future raises BrokenExecutor if the process was killed."""
        return self._threads.submit(self._ask, (fn, args, kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Waits, whatever `wait` says, for the tasks under way and for the end of the processes."""
        self._threads.shutdown(cancel_futures=cancel_futures)
        for worker in self._workers:
            worker.pipe.close()
            worker.process.join()

    def _ask(self, task: tuple[Callable[..., Any], Any, Any]) -> Any:
        worker = self._idle.get()
        try:
            worker.pipe.send(task)
            outcome: _Outcome = worker.pipe.recv()
        except (EOFError, OSError) as error:
            for other in self._workers:  # what they do would be waited for in vain
                other.process.kill()
            raise BrokenExecutor("a worker process was killed") from error
        finally:
            self._idle.put(worker)
        if outcome.error is not None:
            raise outcome.error
        return outcome.result


def _start(initializer: Callable[[], None]) -> _Worker:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, initializer), daemon=True)
    process.start()
    there.close()  # so that the pipe ends with the process
    return _Worker(process, here)


def _serve(pipe: Connection, initializer: Callable[[], None]) -> None:
    """A worker's whole life: one task after the other, until the other end is closed."""
    initializer()
    while True:
        try:
            function, args, kwargs = pipe.recv()
        except EOFError:
            return
        try:
            pipe.send(_Outcome(function(*args, **kwargs), None))
        except Exception as error:
            error.add_note(f"in a worker process:\n{''.join(traceback.format_exception(error))}")
            pipe.send(_Outcome(None, error))
