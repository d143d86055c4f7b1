"""Calls in a separate process: a call that hangs or crashes costs one row of a study, not the whole study."""

import multiprocessing
import os
import signal
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from typing import Any, Self

_START = 600.0  # s that importing everything, and compiling it the first time, may take on a busy machine


class LostError(Exception):
    """A call ended without a result; the arguments are "hangs" or "crashes", and the reason."""


class Worker:
    """A process that takes one call after the other; it is killed and replaced when a call exceeds its budget.

    It works in a temporary folder, because MuJoCo writes its warnings to a file there.

    Args:
        prepare: what the process runs first, so that its time does not count for any call.
    """

    def __init__(self, prepare: Callable[[], object]):
        self._prepare = prepare
        self._pool: ProcessPoolExecutor | None = None
        self._process = 0
        self._folder = tempfile.TemporaryDirectory()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()
        self._folder.cleanup()

    def begin(self) -> ProcessPoolExecutor:
        """Start the process, unless it is running, and let it prepare."""
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
            self._process = self._pool.submit(_begin, self._prepare, self._folder.name).result(_START)
        return self._pool

    def call(self, function: Callable[..., Any], *arguments: Any, budget: float) -> Any:
        """Run a function in the process, for at most ``budget`` seconds, and return its result.

        Raises:
            LostError: if it takes longer, or the process ends.
        """
        pool = self.begin()
        try:
            return pool.submit(function, *arguments).result(budget)
        except TimeoutError:
            self._end()
            raise LostError("hangs", f"no result within {budget:g} s") from None
        except BrokenProcessPool:
            self._end()
            raise LostError("crashes", "the process ended") from None

    def _end(self) -> None:
        if self._pool is not None:
            with suppress(ProcessLookupError):
                os.kill(self._process, signal.SIGKILL)
            self._pool.shutdown()
        self._pool = None


def _begin(prepare: Callable[[], object], folder: str) -> int:
    """Change to the folder, prepare, and return the id of the process."""
    os.chdir(folder)
    prepare()
    return os.getpid()
