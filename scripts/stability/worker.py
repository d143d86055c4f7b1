"""One row of the stability study, measured in a separate process, with its verdict."""

import traceback
import warnings
from pathlib import Path

from impactlaw.errors import ImpactLawError
from scripts import apart

from .verdicts import CRASHES, HANGS, REFUSED, WRONG, Measurement, WrongRefusalError, verdict

Judged = tuple[str, str, Measurement | None]
"""A verdict, the reason why it is not "right", and the measurement if the run ended with one."""


def judged(worker: apart.Worker, case: str, law: str, solver: str, quick: bool, *, budget: float) -> Judged:
    """Return the result of a row, given by names, that may take ``budget`` seconds; quick: see `Stability`."""
    try:
        return worker.call(_measured, case, law, solver, quick, budget=budget)
    except apart.LostError as error:
        how, why = error.args
        return HANGS if how == "hangs" else CRASHES, why, None


def prepare() -> None:
    """Import and compile the code of all rows before the first is timed; turn floating-point warnings into errors."""
    from impactlaw.solvers import load_solvers
    from impactlaw.stepping.time_stepping.make import compile_steps

    load_solvers()
    compile_steps()
    warnings.simplefilter("error", RuntimeWarning)


def _measured(name: str, law: str, solver: str, quick: bool) -> Judged:
    """Run a row, and return its result."""
    from .cases import CASES

    case = CASES[name]
    try:
        measurement = case.measure(law, solver, quick)
    except ImpactLawError as error:
        return REFUSED, f"{type(error).__name__}: {error}", None
    except WrongRefusalError as error:
        return WRONG, str(error), None
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return CRASHES, f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})", None
    return *verdict(measurement, case.limits), measurement
