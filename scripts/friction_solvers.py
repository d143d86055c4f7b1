"""Solvers of contacts with friction: error against time, beside Clarabel, a solver of convex cone programs.

The convex relaxation is a program that Clarabel takes as it is; exact Coulomb friction is not, and Clarabel solves it
by the fixed point of de Saxcé's correction, ``s = |u_t|`` held in every program. The error is the natural map of the
cone, relative to |v-|, the same for all; a problem counts as solved up to 1e-10. Clarabel is no dependency: without it
its rows say so.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import machine
import numpy as np
import pandas as pd
import tyro
from random_collisions import random_collision

from impactlaw.friction_impact import cone_problem
from impactlaw.solvers.cone_problem import ENOUGH, ConeProblem
from impactlaw.solvers.cone_solve import solve_cones

ABSENT = "not installed"
WARM = "impactlaw, warm"  # its own solution is the guess
_ROUNDS = 50  # of the fixed point
_IDLE = 5  # rounds in which the residual does not fall, after which it stops


@dataclass(frozen=True, kw_only=True)
class FrictionSolvers:
    """Which problems, and what Clarabel is asked for."""

    contacts: tuple[int, ...] = (1, 4, 8, 16)
    """Most contacts of a problem."""
    problems: int = 100
    """Random collisions of each size, E = 0."""
    tolerances: tuple[float, ...] = (1e-4, 1e-8, 1e-12)
    """Clarabel's."""
    seed: int = 0
    """Seed of the problems."""
    quick: bool = False
    """Ten problems of up to 4 contacts."""


_NUMBERS = {"median_ms": "{:.2f}", "slowest_ms": "{:.1f}", "error": "{:.0e}", "worst": "{:.0e}", "solved": "{:.0%}"}

Solver = Callable[[ConeProblem], np.ndarray]
"""From a problem to its impulse in the problem's scale, (h, m)."""


def run(study: FrictionSolvers) -> pd.DataFrame:
    """Return one row per cone, size and solver.

    Columns: cone, contacts, solver, median_ms, slowest_ms, error (median of the residuals), worst, solved (part of the
    problems with a residual up to 1e-10), note.
    """
    sizes, count = ((4,), 10) if study.quick else (study.contacts, study.problems)
    rows = []
    for exact in (True, False):
        for contacts in sizes:
            problems = [_problem(study.seed, contacts, k, exact) for k in range(count)]
            for name, solver in _solvers(study, exact).items():
                row = {"cone": "exact" if exact else "convex", "contacts": contacts, "solver": name}
                rows.append(row | _measure(solver, problems, warm=name == WARM))
    return pd.DataFrame(rows)


def _problem(seed: int, contacts: int, k: int, exact: bool) -> ConeProblem:
    return cone_problem(random_collision(np.random.default_rng([seed, contacts, k]), contacts), exact=exact)


def _solvers(study: FrictionSolvers, exact: bool) -> dict[str, Solver | None]:
    found: dict[str, Solver | None] = {"impactlaw": own, WARM: own}
    for tolerance in study.tolerances:
        solver = partial(fixed_point if exact else clarabel_cones, tolerance=tolerance)
        found[f"clarabel {tolerance:g}"] = solver if find_spec("clarabel") else None
    return found


def _measure(solver: Solver | None, problems: list[ConeProblem], *, warm: bool) -> dict[str, object]:
    if solver is None:
        return {"note": ABSENT}
    seconds, errors = [], []
    for problem in problems:
        guess = solve_cones(problem).impulse if warm else None
        began = time.perf_counter()
        x = solver(problem) if guess is None else own(problem, guess)
        seconds.append(time.perf_counter() - began)
        errors.append(problem.residual(x, problem.velocity(x)) / problem.scale)
    return {
        "median_ms": 1e3 * np.median(seconds),
        "slowest_ms": 1e3 * max(seconds),
        "error": np.median(errors),
        "worst": max(errors),
        "solved": np.mean(np.array(errors) <= ENOUGH),
        "note": "",
    }


def own(problem: ConeProblem, guess: np.ndarray | None = None) -> np.ndarray:
    """Solve by this package."""
    return problem.scaled(solve_cones(problem, guess).impulse)


def clarabel_cones(problem: ConeProblem, *, tolerance: float, shift: np.ndarray | None = None) -> np.ndarray:
    """Solve ``min |z|^2 / 2, A z + b + shift e_n ∈ K``; the multipliers are the impulse."""
    clarabel, sparse = import_module("clarabel"), import_module("scipy.sparse")
    h, m = problem.shape
    offset = problem.start.copy()
    if shift is not None:
        offset[:, 0] += shift
    nv = problem.rows.shape[1]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    cones = [clarabel.SecondOrderConeT(m) if m > 1 else clarabel.NonnegativeConeT(1)] * h
    P, A = sparse.csc_matrix(np.eye(nv)), sparse.csc_matrix(-problem.rows)
    result = clarabel.DefaultSolver(P, np.zeros(nv), A, offset.reshape(-1), cones, settings).solve()
    return np.array(result.z).reshape(h, m)


def fixed_point(problem: ConeProblem, *, tolerance: float) -> np.ndarray:
    """Solve exact friction by convex programs with ``s = |u_t|`` held, until the residual stops falling."""
    shift, best, least, idle = np.zeros(problem.shape[0]), np.zeros(problem.shape), np.inf, 0
    for _ in range(_ROUNDS):
        x = clarabel_cones(problem, tolerance=tolerance, shift=shift)
        u = problem.velocity(x)
        residual = problem.residual(x, u)
        idle = idle + 1 if residual >= 0.9 * least else 0
        if residual < least:
            best, least = x, residual
        if idle >= _IDLE:
            break
        shift = np.sqrt(np.vecdot(u[:, 1:], u[:, 1:]))
    return best


def format_table(table: pd.DataFrame) -> str:
    """Return the table as text."""
    shown = table.fillna({"note": ""}).copy()
    for name, form in _NUMBERS.items():
        if name in shown:
            shown[name] = [form.format(value) if value == value else "" for value in shown[name]]
    return shown.to_string(index=False)


def main(study: FrictionSolvers, out: Path = Path("out/friction_solvers")) -> None:
    """Run the study, print its table, and write it as CSV.

    Args:
        study: what to run.
        out: folder for friction_solvers.csv.
    """
    table = run(study)
    out.mkdir(parents=True, exist_ok=True)
    table.to_csv(out / "friction_solvers.csv", index=False)
    print(format_table(table))
    print(machine.one_line())


if __name__ == "__main__":
    tyro.cli(main, description=__doc__, config=(tyro.conf.OmitArgPrefixes,))
