"""Rows of the stability study in a process of their own, so that what hangs is a row and not a hang of the study."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import time
import traceback
import warnings
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as Late
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from threadpoolctl import threadpool_limits

from impactlaw.errors import ImpactLawError

from .verdicts import CRASHES, HANGS, REFUSED, WRONG, Case, Measurement, WrongRefusalError, verdict

_START = 600.0  # s that importing everything, and compiling it the first time, may take on a busy machine


@dataclass(frozen=True)
class Task:
    """One row: names of case, law and solver, and whether the case is run in its quick form."""

    case: str
    law: str
    solver: str
    quick: bool


@dataclass(frozen=True)
class Outcome:
    """What came of a row.

    Attributes:
        verdict: right, refused, WRONG, NaN, HANGS or CRASHES.
        reason: why it is not right.
        measurement: what was measured, or nothing.
        seconds: that the row took, building its scene included.
    """

    verdict: str
    reason: str
    measurement: Measurement | None
    seconds: float


class Worker:
    """A process that measures one row after the other; it is ended and replaced when a row exceeds its budget."""

    def __init__(self):
        self._pool: ProcessPoolExecutor | None = None
        self._process = 0

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def run(self, task: Task, budget: float) -> Outcome:
        """Return the outcome of a row that may take ``budget`` seconds."""
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
            self._process = self._pool.submit(_prepare).result(_START)
        start = time.perf_counter()
        try:
            return self._pool.submit(_measured, task).result(budget)
        except Late:
            ended = HANGS, f"no result within {budget:g} s"
        except BrokenProcessPool:
            ended = CRASHES, "the process ended"
        self.close()
        return Outcome(*ended, None, time.perf_counter() - start)

    def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            with suppress(ProcessLookupError):
                os.kill(self._process, signal.SIGKILL)
            self._pool.shutdown()
        self._pool = None


def _prepare() -> int:
    """Import and compile what a row may use, so that none pays for it; let overflow and invalid numbers be loud.

    With one thread for BLAS: several cost 100 times as much on a busy machine. Returns the process.
    """
    from impactlaw.solvers import load_solvers
    from impactlaw.stepping.time_stepping.make import warm_up

    load_solvers()
    warm_up()
    threadpool_limits(1, "blas")
    warnings.simplefilter("error", RuntimeWarning)
    return os.getpid()


def _measured(task: Task) -> Outcome:
    from .cases import CASES

    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # MuJoCo writes its warnings to a file there
        try:
            return _outcome(CASES[task.case], task)
        finally:
            os.chdir("/")


def _outcome(case: Case, task: Task) -> Outcome:
    start = time.perf_counter()

    def ended(verdict: str, reason: str, measurement: Measurement | None = None) -> Outcome:
        return Outcome(verdict, reason, measurement, time.perf_counter() - start)

    try:
        measurement = case.measure(task.law, task.solver, task.quick)
    except ImpactLawError as error:
        return ended(REFUSED, f"{type(error).__name__}: {error}")
    except WrongRefusalError as error:
        return ended(WRONG, str(error))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return ended(CRASHES, f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})")
    return ended(*verdict(measurement, case.limits), measurement)
