"""The solvers to compare, ours first, with one interface: from a problem and a guess to impulses and iterations."""

from collections.abc import Callable
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from impactlaw.solvers.cones.solve import solve
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import TOLERANCE

from . import clarabel_cones, gauss_seidel
from .problem import Problem

COMPILED = "impactlaw"
_SWEEPS = 1000
_ENOUGH = 1e-10

Call = Callable[[], tuple[np.ndarray, int]]
"""The call that is timed; it returns impulses and the number of iterations."""


class Solver(NamedTuple):
    """One solver.

    Attributes:
        name: name in tables.
        package: import name of the package that it needs.
        bind: returns the call that solves a problem from a guess.
        any_size: whether it gets large problems as well.
    """

    name: str
    package: str
    bind: Callable[[Problem, np.ndarray], Call]
    any_size: bool = True


def solvers() -> list[Solver]:
    """Return the solvers whose packages are installed, and print which ones are left out."""
    found = []
    for solver in _ALL:
        if find_spec(solver.package) is None:
            print(f"{solver.package} is not installed: {solver.name} is left out")
        else:
            found.append(solver)
    return found


def compiled(problem: Problem, guess: np.ndarray) -> Call:
    """Return the call of our own solver, with the arguments that time stepping gives it."""
    *known, exact = problem.fields
    arguments = *known[:4], problem.rows.shape[1], *known[4:], guess, exact, TOLERANCE, problem.rounds, np.inf

    def call() -> tuple[np.ndarray, int]:
        x, _, _, taken = solve(*arguments)
        return x, taken

    return call


def _gauss_seidel(problem: Problem, guess: np.ndarray) -> Call:
    fields = problem.fields

    def call() -> tuple[np.ndarray, int]:
        x = guess.copy()
        return x, gauss_seidel.sweep(fields, x, _ENOUGH * problem.scale, _SWEEPS)

    return call


def _clarabel(problem: Problem, guess: np.ndarray) -> Call:
    return lambda: clarabel_cones.fixed_point(problem, guess)


_ALL = (
    Solver(COMPILED, "impactlaw", compiled),
    Solver("Gauss-Seidel", "numba", _gauss_seidel),
    Solver("Clarabel", "clarabel", _clarabel, any_size=False),
)
