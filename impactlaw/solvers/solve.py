"""Solve a problem: choose a solver, certify its answer, and share the impulse among redundant contacts."""

from __future__ import annotations

from contextlib import nullcontext
from importlib import import_module
from math import prod

import numpy as np

from impactlaw.errors import DivergenceError, SolverError, UnknownNameError, UnsolvableLawError
from impactlaw.solvers.certificate import LARGEST_POLISHED, Answer, better, judge, judge_active, polish
from impactlaw.solvers.infeasibility import farkas_ray
from impactlaw.solvers.least_norm import share_impulse
from impactlaw.solvers.least_squares import row_span
from impactlaw.solvers.methods.closed_form import closed_form
from impactlaw.solvers.methods.dual_active_set import dual_active_set
from impactlaw.solvers.methods.least_distance import least_distance
from impactlaw.solvers.methods.nnls import nnls
from impactlaw.solvers.methods.osqp import osqp
from impactlaw.solvers.methods.primal_dual_active_set import primal_dual_active_set
from impactlaw.solvers.methods.projected_gauss_seidel import projected_gauss_seidel
from impactlaw.solvers.one_thread import one_thread
from impactlaw.solvers.problem import Problem, Solution, Solver, Status
from impactlaw.solvers.sparsity import as_dense, groups, structured
from impactlaw.solvers.tolerances import CERTIFIED, GOOD, GOOD_LARGE, RANK, TIGHT, TINY

SOLVERS: dict[str, Solver] = {
    "closed-form": closed_form,
    "nnls": nnls,
    "dual-active-set": dual_active_set,
    "primal-dual-active-set": primal_dual_active_set,
    "least-distance": least_distance,
    "osqp": osqp,
    "projected-gauss-seidel": projected_gauss_seidel,
}
"""The registry of solvers: a new solver is one file and one line here."""

_ITERATIVE = {"osqp", "projected-gauss-seidel"}
_TAKE_SPARSE = {"primal-dual-active-set", *_ITERATIVE}
_MANY = 64  # contacts from which linear algebra would start several threads


def check_solver(name: str) -> None:
    """Raise UnknownNameError unless the name is in `SOLVERS` or "auto"."""
    if name != "auto" and name not in SOLVERS:
        raise UnknownNameError("solver", name, [*SOLVERS, "auto"])


def load_solvers() -> None:
    """Import the modules that collisions need, so that no step of a simulation has to wait for them."""
    for name in ("daqp", "scipy.linalg", "scipy.optimize", "scipy.sparse.csgraph"):
        import_module(name)


def solve(problem: Problem, labels: tuple[str, ...], *, solver: str = "auto") -> np.ndarray:
    """Return the impulse of least norm that solves the problem, shape (h,); see `solve_with_jump`."""
    return solve_with_jump(problem, labels, solver=solver).impulse


def solve_with_jump(problem: Problem, labels: tuple[str, ...], *, solver: str = "auto", shared: bool = True) -> Answer:
    """Return the impulse of least norm that solves the problem, and its velocity jump.

    Args:
        problem: the problem to solve.
        labels: names of the contacts, for messages.
        solver: a name from `SOLVERS`, or "auto": the closed form for one contact, NNLS if the law knows a velocity with
            the wanted contact velocities, a dual active set otherwise, and further solvers if an answer is not
            certified.
        shared: whether redundant contacts share the impulse; if not, any impulse that solves the problem is returned.
            The jump is the same.

    Raises:
        UnknownNameError: there is no such solver.
        UnsolvableLawError: the problem has no solution.
        SolverError: no solver's answer passed the certificate.
        DivergenceError: the problem contains numbers that are not finite.
    """
    check_solver(solver)
    c = problem.bound
    if not np.count_nonzero(c > 0):  # takes a quarter of the time of any(), and every collision passes here
        return Answer(np.zeros(len(c)), np.zeros(problem.gradients.shape[1]), -c / problem.lengths, 0.0)
    if problem.speed < TINY and np.abs(c).max() < TINY and problem.scale < TINY:
        up, d = 2.0**900, problem.preimage
        larger = Problem(problem.gradients, up * c, None if d is None else up * d, up * problem.speed)
        impulse, jump, slack, residual = solve_with_jump(larger, labels, solver=solver, shared=shared)
        return Answer(impulse / up, jump / up, slack / up, residual / up)
    try:
        with nullcontext() if len(c) < _MANY else one_thread():
            return _solve(problem, labels, solver, shared=shared)
    except (ValueError, ZeroDivisionError) as error:  # linear algebra raises these for numbers that are not finite
        if np.isfinite(c).all() and np.isfinite(problem.norms).all():
            raise
        raise DivergenceError(
            "velocities or inertia of contacts are not finite: look at masses, sizes, armature"
        ) from error


def _solve(problem: Problem, labels: tuple[str, ...], solver: str, *, shared: bool) -> Answer:
    """Return the answer of `solve_with_jump` for a problem in which zero impulses are not a solution."""
    if not problem.can_move:
        return _solve_moving(problem, labels, solver)
    if solver == "auto":
        problem = structured(problem)
        answer = None if problem.is_sparse else judge_active(problem, slice(None))
        if answer is not None and problem.allows(answer.residual, GOOD):
            return share(problem, answer) if shared else answer
    elif not problem.is_sparse and len(parts := groups(problem)) > 1:
        return _solve_apart(problem, labels, solver, parts)
    answer, last = _attempt(problem, solver, labels)
    if not _certified(problem, answer):
        if solver == "auto":  # the problem may consist of rounding errors only: then zero impulses solve it
            answer = better(answer, judge(problem, np.zeros_like(problem.bound)))
        if not _certified(problem, answer):
            _refuse(problem, labels)
            reached = "no answer" if answer is None else f"relative residual {answer.residual / problem.scale:.1e}"
            if solver in _ITERATIVE and last is not None:
                reached += f" (status {last.status}, {last.iterations} iterations, residual {last.residual:.1e})"
            raise SolverError(
                f"solver {solver!r} reached {reached} on {len(labels)} contacts; "
                "try another solver, or check the scene for contacts of very different scale, or opposite to each other"
            )
    assert answer is not None
    return share(problem, answer) if shared else answer


def nonnegative_combination(gradients: np.ndarray, point: np.ndarray, *, shared: bool = True) -> np.ndarray:
    """Return the ``Lambda >= 0`` of least norm that minimizes ``|Y^T Lambda - point|``, (h,), for Y, (h, nv).

    If not `shared`, return any minimiser.
    """
    problem, labels = Problem(gradients, gradients @ point, point), ("",) * gradients.shape[0]
    return solve_with_jump(problem, labels, shared=shared).impulse


def _attempt(problem: Problem, solver: str, labels: tuple[str, ...]) -> tuple[Answer | None, Solution | None]:
    """Try one solver after another until an answer is good; return the best answer and the last solver's solution."""
    best = last = None
    dear = problem.is_sparse and prod(problem.gradients.shape) > LARGEST_POLISHED
    for name in _candidates(problem, solver):
        form = problem if name in _TAKE_SPARSE else as_dense(problem)
        if form is None:
            continue
        last = SOLVERS[name](form)
        if last.status is Status.INFEASIBLE:
            _refuse(problem, labels)
        if last.status is Status.SOLVED or name in _ITERATIVE:
            best = better(best, polish(problem, last.impulse))
            if problem.allows(best.residual, GOOD_LARGE if dear else GOOD):
                break
    return best, last


def _certified(problem: Problem, answer: Answer | None) -> bool:
    return answer is not None and answer.residual <= CERTIFIED * problem.speed_at(answer.jump)


def _candidates(problem: Problem, solver: str) -> tuple[str, ...]:
    if solver != "auto":
        return (solver,)
    if problem.is_sparse:
        return ("primal-dual-active-set", "nnls", "dual-active-set", "least-distance")
    if len(problem.bound) == 1:
        return ("closed-form",)
    if problem.preimage is not None:
        return ("nnls", "dual-active-set", "least-distance")
    return ("dual-active-set", "least-distance", "nnls")


def _solve_moving(problem: Problem, labels: tuple[str, ...], solver: str) -> Answer:
    """Solve without the contacts whose gradient is zero; if the law wants such a contact to open, raise."""
    moving = problem.norms > 0
    wanted = ~moving & (problem.bound > 0)
    if wanted.any():
        raise UnsolvableLawError([labels[i] for i in np.flatnonzero(wanted)], wanted.astype(float))
    part = Problem(problem.gradients[moving], problem.bound[moving], problem.preimage, problem.speed)
    answer = _solve_part(part, np.flatnonzero(moving), labels, solver)
    impulse, slack = np.zeros_like(problem.bound), -problem.bound
    impulse[moving], slack[moving] = answer.impulse, answer.slack
    return Answer(impulse, answer.jump, slack, answer.residual)


def _solve_apart(problem: Problem, labels: tuple[str, ...], solver: str, parts: list[np.ndarray]) -> Answer:
    """Solve each group of coupled contacts separately, since errors are relative to speeds, which may differ."""
    impulse, jump = np.zeros_like(problem.bound), np.zeros(problem.gradients.shape[1])
    for rows in parts:
        Y, d = problem.gradients[rows], problem.preimage
        if d is not None:
            span, _ = row_span(Y, RANK)
            d = d @ span.T @ span
        part = Problem(Y, problem.bound[rows], d)
        answer = _solve_part(part, rows, labels, solver)
        impulse[rows] = answer.impulse
        jump += answer.jump
    return judge(problem, impulse, jump)


def _solve_part(part: Problem, rows: np.ndarray, labels: tuple[str, ...], solver: str) -> Answer:
    """Solve the problem of some rows; if it has no solution, raise with a Farkas ray over all contacts."""
    try:
        return solve_with_jump(part, tuple(labels[i] for i in rows), solver=solver)
    except UnsolvableLawError as error:
        ray = np.zeros(len(labels))
        ray[rows] = error.ray
        raise UnsolvableLawError(error.contacts, ray) from None


def _refuse(problem: Problem, labels: tuple[str, ...]) -> None:
    """Raise UnsolvableLawError if a Farkas ray exists; a problem with a preimage always has a solution."""
    if problem.preimage is not None:
        return
    dense = as_dense(problem)
    ray = None if dense is None else farkas_ray(dense)
    if ray is not None:
        raise UnsolvableLawError([labels[i] for i in np.flatnonzero(ray)], ray)


def share(problem: Problem, answer: Answer) -> Answer:
    """Share the impulse among redundant contacts (least norm), unless this makes the residual clearly larger.

    If the contacts that carry an impulse are independent, the impulse is unique unless another contact is tight.
    """
    impulse = answer.impulse
    if not problem.can_move or not impulse.any():  # `_solve_moving` has already shared it
        return answer
    tight = answer.slack <= TIGHT * problem.scale
    if not problem.is_sparse:
        alone = np.count_nonzero(tight) <= np.count_nonzero(impulse)
        if alone and judge_active(problem, impulse > 0) is not None:
            return answer
        problem = structured(problem)
    least = share_impulse(problem.gradients, impulse, tight | (impulse > 0))
    if least is impulse:
        return answer
    answer_shared = judge(problem, least, answer.jump)
    return answer_shared if answer_shared.residual <= max(10 * answer.residual, GOOD * problem.scale) else answer
