"""Rows of the stability study in a process of their own, so that what hangs is a row and not a hang of the study."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

from stability_verdicts import CRASHES, HANGS, REFUSED, WRONG, Measurement, WrongRefusalError, verdict

_START = 120.0  # s that importing everything may take on a busy machine


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
        self._context = multiprocessing.get_context("spawn")
        self._process = None
        self._pipe: Connection | None = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def run(self, task: Task, budget: float) -> Outcome:
        """Return the outcome of a row that may take ``budget`` seconds."""
        pipe = self._pipe or self._start()
        pipe.send(task)
        start = time.perf_counter()
        try:
            if pipe.poll(budget):
                return pipe.recv()
        except EOFError:
            self.close()
            return Outcome(CRASHES, "the process ended", None, time.perf_counter() - start)
        self.close()
        return Outcome(HANGS, f"no result within {budget:g} s", None, time.perf_counter() - start)

    def close(self) -> None:
        """End the process."""
        if self._pipe is not None:
            self._pipe.close()
        if self._process is not None:
            self._process.kill()
            self._process.join()
        self._process = self._pipe = None

    def _start(self) -> Connection:
        self._pipe, theirs = self._context.Pipe()
        self._process = self._context.Process(target=_serve, args=(theirs,), daemon=True)
        with _one_blas_thread():
            self._process.start()
        theirs.close()
        if not self._pipe.poll(_START):
            raise TimeoutError(f"the worker did not start within {_START:g} s")
        self._pipe.recv()
        return self._pipe


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Let processes that start meanwhile use one BLAS thread: several cost 100 times as much on a busy machine."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    kept = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in kept.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _serve(pipe: Connection) -> None:
    from stability_cases import CASES

    from impactlaw.solvers import load_solvers

    load_solvers()  # no row should pay for what is imported when it is first used
    warnings.simplefilter("error", RuntimeWarning)  # overflow or an invalid number is loud
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # MuJoCo writes its warnings to a file there
        pipe.send("ready")
        while True:
            try:
                task: Task = pipe.recv()
            except EOFError:
                return
            pipe.send(_outcome(CASES[task.case], task))


def _outcome(case, task: Task) -> Outcome:
    from impactlaw.errors import ImpactLawError

    start = time.perf_counter()
    try:
        measurement = case.measure(task.law, task.solver, task.quick)
    except ImpactLawError as error:
        refusal = f"{type(error).__name__}: {error}"
        return Outcome(REFUSED, refusal, None, time.perf_counter() - start)
    except WrongRefusalError as error:
        return Outcome(WRONG, str(error), None, time.perf_counter() - start)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        return Outcome(CRASHES, reason, None, time.perf_counter() - start)
    seconds = time.perf_counter() - start
    return Outcome(*verdict(measurement, case.limits), measurement, seconds)
