"""Work and precision of the solvers: residual and error of energy against time per impact, over size and condition."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.sparse import csr_array
from work_precision_problems import ExactProblem, chain, dense

from impactlaw.errors import ImpactLawError
from impactlaw.solvers import SOLVERS, Problem, Solution, Solver, Status, solve_with_jump

CERTIFIED = "auto, certified"
"""The package's own choice of solvers with its certificate and least-norm impulse, beside the bare solvers."""
SWEEPS: dict[str, tuple[float, ...]] = {
    "sweeps": (10, 100, 1000),
    "iterations": (100, 1000, 10_000),
    "tolerance": (1e-3, 1e-6, 1e-9),
}
"""Keywords of iterative solvers; a solver that has one is run with each of these values besides its default."""
_LARGEST_DENSE = 1000  # contacts of a chain that solvers of dense data are given
_SLOW = 0.1  # s; a solver that took longer is not timed again
_LONG = 1.0  # s; a solver that took longer is given one problem of a kind only, one that is going to take longer none

Outcome = tuple[np.ndarray, np.ndarray | None] | None
"""Impulse, and jump where it was computed apart from it; None where the solver says that it has no answer."""


@dataclass(frozen=True, kw_only=True)
class SolverStudy:
    """Which problems to solve, and how long to time each.

    Attributes:
        contacts: sizes of random dense problems, half of the contacts active.
        chains: contacts of chains of balls; above 1 000 for solvers of sparse data only.
        conditions: condition numbers, of Y (dense) or of the mass matrix (chains).
        problems: number of random problems of each kind; the largest error of them counts.
        seconds: time spent on timing one solver on one problem.
    """

    contacts: tuple[int, ...] = (1, 4, 16, 64, 256)
    chains: tuple[int, ...] = (100, 1000, 10_000)
    conditions: tuple[float, ...] = (1.0, 1e4, 1e8, 1e12)
    problems: int = 3
    seconds: float = 0.02


@dataclass(frozen=True, eq=False)
class Candidate:
    """A solver as it is called on one form of the data.

    Attributes:
        name: of the solver, for tables.
        setting: the value of a keyword it is called with, for tables.
        solve: from the problem to its outcome; what stops short of an answer counts where a setting asked for it.
    """

    name: str
    setting: str
    solve: Callable[[Problem], Outcome]


def run(study: SolverStudy, progress: Callable[[str], object] = lambda _: None) -> pd.DataFrame:
    """Return one row per solver, family, size and condition.

    Columns: family; contacts; condition; solver; setting of an iterative one; data it was given (dense or sparse);
    problems that it was given; solved, the part of them; time per impact, s, median; residual and energy error, the
    largest of the problems that it solved (see `work_precision_problems.ExactProblem.errors`). A bare solver that would
    take seconds, if its time grows like the number of contacts, is given no problem.
    """
    rows, per_contact = [], {}
    for family, contacts, condition in kinds(study):
        progress(f"{family}, h = {contacts}, condition {condition:.0e}")
        build = dense if family == "dense" else chain
        problems = [build(contacts, condition, seed) for seed in range(study.problems)]
        for sparse in (False, True):
            for candidate in candidates(family, contacts, sparse=sparse):
                row = {"family": family, "contacts": contacts, "condition": condition}
                row |= {"solver": candidate.name, "setting": candidate.setting, "data": "sparse" if sparse else "dense"}
                kind = family, condition, candidate.name, candidate.setting, sparse
                short = candidate.name == CERTIFIED or per_contact.get(kind, 0.0) * contacts <= _LONG
                measured = _measure(study, candidate, problems if short else [], sparse)
                per_contact[kind] = measured["seconds"] / contacts
                rows.append(row | measured)
    return pd.DataFrame(rows)


def kinds(study: SolverStudy) -> Iterator[tuple[str, int, float]]:
    """Yield family, size and condition of every kind of problem; one contact has condition 1 only."""
    for h in study.contacts:
        for condition in study.conditions if h > 1 else (1.0,):
            yield "dense", h, condition
    for h in study.chains:
        for condition in study.conditions:
            yield "chain", h, condition


def candidates(family: str, contacts: int, *, sparse: bool) -> Iterator[Candidate]:
    """Yield every solver of the registry that takes such data, and the package's own choice."""
    if sparse and family != "chain":
        return
    if not sparse and contacts > _LARGEST_DENSE:
        return
    for name, solver in SOLVERS.items():
        if (name != "closed-form" or contacts == 1) and (not sparse or takes_sparse(name)):
            yield Candidate(name, "", lambda problem, solver=solver: _outcome(solver(problem)))
            yield from swept(name, solver)
    if not sparse or takes_sparse("auto"):
        yield Candidate(CERTIFIED, "", _certified)


def swept(name: str, solver: Solver) -> Iterator[Candidate]:
    """Yield an iterative solver with every value of the keywords in `SWEEPS` that it has."""
    for keyword, values in SWEEPS.items():
        if keyword in inspect.signature(solver).parameters:
            for value in values:
                kind = int if float(value).is_integer() else float
                call = partial(solver, **{keyword: kind(value)})
                yield Candidate(name, f"{keyword} {value:g}", lambda problem, call=call: (call(problem).impulse, None))


def takes_sparse(name: str) -> bool:
    """Whether a solver, or "auto", solves two contacts given as a sparse matrix."""
    try:
        problem = Problem(csr_array(np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])), np.array([1.0, 0.5]))  # pyright: ignore[reportArgumentType]
        outcome = _certified(problem) if name == "auto" else _outcome(SOLVERS[name](problem))
    except Exception:  # whatever a dense solver trips over
        return False
    return outcome is not None and np.allclose(outcome[0], [5 / 6, 2 / 3])


def _certified(problem: Problem) -> Outcome:
    try:
        answer = solve_with_jump(problem, ("",) * len(problem.bound))
    except ImpactLawError:
        return None
    return answer.impulse, answer.jump


def _outcome(solution: Solution) -> Outcome:
    return (solution.impulse, None) if solution.status is Status.SOLVED else None


def _measure(study: SolverStudy, candidate: Candidate, problems: list[ExactProblem], sparse: bool) -> dict[str, float]:
    if not problems:
        return dict.fromkeys(("solved", "seconds", "residual", "energy_error"), np.nan) | {"problems": 0}
    spent, errors = [], []
    for exact in problems:
        if spent and spent[-1] > _LONG:
            break
        given = exact if sparse or not isinstance(exact.gradients, csr_array) else _as_dense(exact)
        problem = given.problem()
        begin = time.perf_counter()
        outcome = candidate.solve(problem)
        first = time.perf_counter() - begin
        spent.append(_time(candidate, given, first, study.seconds))
        if outcome is not None:
            errors.append(exact.errors(*outcome))
    residual, energy = np.max(errors, axis=0) if errors else (np.nan, np.nan)
    return {
        "problems": len(spent),
        "solved": len(errors) / len(spent),
        "seconds": float(np.median(spent)),
        "residual": residual,
        "energy_error": energy,
    }


def _as_dense(exact: ExactProblem) -> ExactProblem:
    return replace(exact, gradients=np.asarray(exact.gradients.toarray()))  # pyright: ignore[reportAttributeAccessIssue]


def _time(candidate: Candidate, exact: ExactProblem, first: float, seconds: float) -> float:
    """Return the median time of building the problem from Y, c and d and solving it, s."""
    if first > _SLOW:
        return first
    times = []
    while len(times) < 3 or (sum(times) < seconds and len(times) < 1000):
        parts = exact.gradients, exact.problem().bound, exact.preimage, exact.problem().speed
        begin = time.perf_counter()
        candidate.solve(Problem(*parts))  # pyright: ignore[reportArgumentType]
        times.append(time.perf_counter() - begin)
    return float(np.median(times))
