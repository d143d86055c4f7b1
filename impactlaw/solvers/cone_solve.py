"""From a problem of contacts with friction to its impulse: Newton's method first, safer and slower ones after it."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cone_lagrangian import augmented_lagrangian
from impactlaw.solvers.cone_newton import continuation, newton, share
from impactlaw.solvers.cone_problem import ENOUGH, ConeAnswer, ConeProblem, ConeStatus

_WARM = 8  # Newton steps that a guess is worth
_COLD = 15  # Newton steps from rest, before what is slower
_VARIANTS = ((1e-12, 1.0), (1e-12, 1.0), (1e-8, 1.0), (1e-12, 0.1), (1e-10, 10.0), (1e-8, 0.3))
"""Regularization and step of the map that are tried in turn: where one cycles another one need not."""
_AFTER = 20  # Newton steps after each round of what is slower
_ROUNDS = 15  # of the fixed point of de Saxcé's correction, or of augmented Lagrangians with less compliance


def solve_cones(problem: ConeProblem, guess: np.ndarray | None = None) -> ConeAnswer:
    """Solve a problem of contacts with friction.

    Newton's method is started from the guess, then from no impulse. What it cannot do is tried by a fixed point: de
    Saxcé's correction ``s = |u_t|`` is held, the convex problem that remains is solved by augmented Lagrangians, and
    Newton's method starts from there; and last by following the solution of compliant contacts to rigid ones.
    Solutions need not be unique for large coefficients of friction; the same problem always gets the same one.

    Args:
        problem: what to solve.
        guess: an impulse near the solution, (n,), such as that of a step before.

    Returns:
        The best answer found; its status is "solved" if its residual is at most 1e-10 of the problem's scale.
    """
    with np.errstate(all="ignore"):
        x, residual, taken = _attempts(problem, guess)
    status = ConeStatus.SOLVED if residual <= ENOUGH * problem.scale else ConeStatus.STOPPED
    return problem.answer(x, residual, status, taken)


def shared(problem: ConeProblem, answer: ConeAnswer) -> ConeAnswer:
    """Return the answer with the impulse shared among redundant contacts, of least norm in the scale of the problem."""
    x = problem.scaled(answer.impulse)
    with np.errstate(all="ignore"):
        least = share(problem, x, answer.residual)
    if least is x:
        return answer
    return problem.answer(least, problem.residual(least, problem.velocity(least)), answer.status, answer.iterations)


def _attempts(problem: ConeProblem, guess: np.ndarray | None) -> tuple[np.ndarray, float, int]:
    """Return the scaled impulse of the first attempt that succeeds, or of the best one; its residual; all steps."""
    enough, taken = ENOUGH * problem.scale, 0
    best: tuple[np.ndarray, float] = np.zeros(problem.shape), np.inf
    for k, (start, steps, most) in enumerate(_starts(problem, guess)):
        regular, factor = _VARIANTS[k % len(_VARIANTS)]
        x, residual, more = newton(problem, start, most=most, regular=regular, factor=factor)
        taken += steps + more
        if residual < best[1]:
            best = x, residual
        if residual <= enough:
            break
    return *best, taken


def _starts(problem: ConeProblem, guess: np.ndarray | None):
    """Yield where Newton's method is to start, the steps that it took to get there, and the steps to give it."""
    if guess is not None:
        yield problem.scaled(guess), 0, _WARM
    yield np.zeros(problem.shape), 0, _COLD
    x, shift = np.zeros(problem.shape), np.zeros(problem.shape[0])
    enough = (1e-6 if problem.exact else 1e-13) * problem.scale
    for k in range(_ROUNDS):
        outer, compliance = (6, 1.0) if k == 0 else (6, 1e-2) if problem.exact else (1, 10.0 ** -(5 + k))
        x, steps = augmented_lagrangian(problem, x, shift, outer=outer, enough=enough, compliance=compliance)
        yield x, steps, _AFTER
        if problem.exact:
            u = problem.velocity(x)
            shift = np.sqrt(np.vecdot(u[:, 1:], u[:, 1:]))
    if problem.exact:
        x, steps = continuation(problem)
        yield x, steps, 4 * _AFTER
