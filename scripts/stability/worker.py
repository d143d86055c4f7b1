"""One row of the stability study, measured in a separate process, with its verdict."""

import time
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path

from threadpoolctl import threadpool_limits

from impactlaw.errors import ImpactLawError
from scripts import apart

from .verdicts import CRASHES, HANGS, REFUSED, WRONG, Measurement, WrongRefusalError, verdict


@dataclass(frozen=True)
class Task:
    """One row: the names of case, law and solver, and whether to run the case in its quick form."""

    case: str
    law: str
    solver: str
    quick: bool


@dataclass(frozen=True)
class Outcome:
    """The outcome of a row.

    Attributes:
        verdict: right, refused, WRONG, NaN, HANGS or CRASHES.
        reason: why it is not right.
        measurement: the measurement, or None if the run did not end with one.
        seconds: wall time of the row, s, with the building of its scene.
    """

    verdict: str
    reason: str
    measurement: Measurement | None
    seconds: float


class Worker(apart.Worker):
    """Measures one row after the other."""

    def __init__(self):
        super().__init__(_prepare)

    def run(self, task: Task, budget: float) -> Outcome:
        """Return the outcome of a row that may take ``budget`` seconds."""
        start = time.perf_counter()
        found: tuple[str, str, Measurement | None]
        try:
            found = self.call(_measured, task, budget=budget)
        except apart.HangsError as error:
            found = HANGS, str(error), None
        except apart.CrashesError as error:
            found = CRASHES, str(error), None
        return Outcome(*found, time.perf_counter() - start)


def _prepare() -> None:
    """Import and compile the code of all rows before the first is timed; turn floating-point warnings into errors.

    BLAS gets one thread, because several take 100 times as long on a busy machine.
    """
    from impactlaw.solvers import load_solvers
    from impactlaw.stepping.time_stepping.make import warm_up

    load_solvers()
    warm_up()
    threadpool_limits(1, "blas")
    warnings.simplefilter("error", RuntimeWarning)


def _measured(task: Task) -> tuple[str, str, Measurement | None]:
    """Run a row, and return its verdict, reason and measurement."""
    from .cases import CASES

    case = CASES[task.case]
    try:
        measurement = case.measure(task.law, task.solver, task.quick)
    except ImpactLawError as error:
        return REFUSED, f"{type(error).__name__}: {error}", None
    except WrongRefusalError as error:
        return WRONG, str(error), None
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return CRASHES, f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})", None
    return *verdict(measurement, case.limits), measurement
