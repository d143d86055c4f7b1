"""The solvers that are compared, ours first, in one form: from a problem and a guess to impulses and iterations."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from impactlaw.solvers.cones import solve
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import TOLERANCE

from . import clarabel_cones
from .problem import Problem

COMPILED, CLARABEL = "impactlaw", "Clarabel"

Call = Callable[[], tuple[np.ndarray, int]]
"""What is timed; it returns impulses and iterations."""
Solvers = dict[str, Callable[[Problem, np.ndarray], Call]]
"""By name, what binds a problem and a guess to the call that solves it."""


def solvers() -> Solvers:
    """Return our solver, and Clarabel where it is installed."""
    if find_spec("clarabel") is None:
        print(f"clarabel is not installed: {CLARABEL} is left out")
        return {COMPILED: compiled}
    return {
        COMPILED: compiled,
        CLARABEL: lambda problem, guess: lambda: clarabel_cones.fixed_point(problem, guess),
    }


def compiled(problem: Problem, guess: np.ndarray) -> Call:
    """Return the call of our own solver, as time stepping makes it."""
    rows = problem.rows
    arguments = (
        np.diff(rows.indptr), rows.indptr[:-1].copy(), rows.indices, rows.data, rows.shape[1], problem.tree,
        problem.first, problem.size, problem.kind, problem.bound, problem.compliance, problem.offset, guess,
        problem.exact, TOLERANCE, problem.rounds,
    )  # fmt: skip

    def call() -> tuple[np.ndarray, int]:
        x, _, _, taken = solve(*arguments)
        return x, taken

    return call
