"""From a problem of contacts with friction to its impulse: Newton's method first, safer and slower ones after it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from impactlaw.solvers.friction.augmented_lagrangian import augmented_lagrangian
from impactlaw.solvers.friction.problem import ENOUGH, ConeAnswer, ConeProblem, ConeStatus, project
from impactlaw.solvers.friction.semismooth_newton import continuation, newton, share
from impactlaw.solvers.friction.single_contact import single
from impactlaw.solvers.one_thread import one_thread

_WARM = 8  # Newton steps that a guess is worth
_COLD = 15  # Newton steps from rest, before what is slower
_VARIANTS = ((1e-12, 1.0), (1e-12, 1.0), (1e-8, 1.0), (1e-12, 0.1), (1e-10, 10.0), (1e-8, 0.3))
"""Regularization and step of the map that are tried in turn: where one cycles another one need not."""
_ALONE = 1e-13  # relative residual with which the answer for a contact alone needs no Newton step
_SHARP, _ROUNDS = 1e-13, 24  # relative residual that the compiled solver aims at, and rounds of its slower methods
_AFTER = 20  # Newton steps after each round of what is slower


class Effort(NamedTuple):
    """How much to try where Newton's method fails.

    Attributes:
        rounds: of the fixed point of de Saxcé's correction, or of augmented Lagrangians with less compliance.
        continued: whether to follow compliant contacts to rigid ones.
        restarts: how often to start again in the end, at about 3 ms each.
    """

    rounds: int
    continued: bool
    restarts: int


THOROUGH = Effort(15, True, 60)
USUAL = Effort(15, True, 0)
BRIEF = Effort(4, False, 0)
COMPILED = Effort(0, False, 0)
"""Newton's method, and what is compiled."""


def solve_cones(problem: ConeProblem, guess: np.ndarray | None = None, *, effort: Effort = THOROUGH) -> ConeAnswer:
    """Solve a problem of contacts with friction.

    One contact alone has a closed form, or nearly so (`cone_single`). Newton's method is started from the guess, then
    from no impulse. What it cannot do is tried by a fixed point: de Saxcé's correction ``s = |u_t|`` is held, the
    convex problem that remains is solved by augmented Lagrangians, and Newton's method starts from there; and by
    following the solution of compliant contacts to rigid ones. Then comes the compiled solver of time stepping
    (`impactlaw.solvers.cones`); and last, starting from all these again, displaced by random numbers that are always
    the same. Solutions need not be unique for large coefficients of friction; the same problem always gets the same
    one.

    Args:
        problem: what to solve.
        guess: an impulse near the solution, (n,), such as that of a step before.
        effort: how much to try where Newton's method fails.

    Returns:
        The best answer found; its status is "solved" if its residual is at most 1e-10 of the problem's scale.
    """
    if problem.exact and problem.shape[0] == 1:
        x = single(problem, guess)
        if x is not None and (residual := problem.residual(x, problem.velocity(x))) <= _ALONE * problem.scale:
            return problem.answer(x, residual, ConeStatus.SOLVED, 0)
    with one_thread():
        return _solve(problem, guess, effort)


def _solve(problem: ConeProblem, guess: np.ndarray | None, effort: Effort) -> ConeAnswer:
    """Try one method after the other."""
    x, residual, taken = np.zeros(problem.shape), np.inf, 0
    methods = (
        lambda: _attempts(problem, _first(problem, guess)),
        lambda: _attempts(problem, _starts(problem, effort._replace(restarts=0))),
        lambda: _compiled(problem, guess),
        lambda: _attempts(problem, _starts(problem, effort)),
    )
    with np.errstate(all="ignore"):
        for method in methods:
            other, least, more = method()
            taken += more
            if not residual <= least:
                x, residual = other, least
            if residual <= ENOUGH * problem.scale:
                break
    status = ConeStatus.SOLVED if residual <= ENOUGH * problem.scale else ConeStatus.STOPPED
    return problem.answer(x, residual, status, taken)


def _compiled(problem: ConeProblem, guess: np.ndarray | None) -> tuple[np.ndarray, float, int]:
    """Return what the compiled solver finds: scaled impulse, (h, m), residual, iterations."""
    from impactlaw.solvers.cones import CONE, solve

    (h, m), nv = problem.shape, problem.rows.shape[1]
    n = h * m
    start = np.zeros(n) if guess is None else np.array(problem.scaled(guess), dtype=float).reshape(-1)
    x, _, _, taken = solve(
        np.full(n, nv, np.int32),
        np.arange(0, n * nv, nv, dtype=np.int32) if nv else np.zeros(n, np.int32),
        np.tile(np.arange(nv, dtype=np.int32), n),
        np.ascontiguousarray(problem.rows).reshape(-1),
        nv,
        np.zeros(nv, np.int32),
        np.arange(0, n, m, dtype=np.int32),
        np.full(h, m, np.int32),
        np.full(h, CONE, np.int32),
        np.zeros(h),
        np.zeros(n),
        problem.start.flatten(),
        start,
        problem.exact,
        _SHARP,
        _ROUNDS,
    )
    x = x.reshape(h, m)
    with np.errstate(all="ignore"):
        residual = problem.residual(x, problem.velocity(x))
    return x, residual if residual >= 0 else np.inf, int(taken)


def shared(problem: ConeProblem, answer: ConeAnswer) -> ConeAnswer:
    """Return the answer with the impulse shared among redundant contacts, of least norm in the scale of the problem."""
    x = problem.scaled(answer.impulse)
    with np.errstate(all="ignore"):
        least = share(problem, x, answer.residual)
    if least is x:
        return answer
    return problem.answer(least, problem.residual(least, problem.velocity(least)), answer.status, answer.iterations)


_Starts = Iterator[tuple[np.ndarray, int, int, tuple[float, float]]]
"""Where Newton's method is to start, the steps that led there, the steps to give it, and its variant."""


def _attempts(problem: ConeProblem, starts: _Starts) -> tuple[np.ndarray, float, int]:
    """Return the scaled impulse of the first attempt that succeeds, or of the best one; its residual; all steps."""
    enough, taken = ENOUGH * problem.scale, 0
    best: tuple[np.ndarray, float] = np.zeros(problem.shape), np.inf
    for start, steps, most, variant in starts:
        x, residual, more = newton(problem, start, most=most, regular=variant[0], factor=variant[1])
        taken += steps + more
        if residual < best[1]:
            best = x, residual
        if residual <= enough:
            break
    return *best, taken


def _first(problem: ConeProblem, guess: np.ndarray | None) -> _Starts:
    """Yield the guess, then no impulse."""
    if guess is not None:
        yield problem.scaled(guess), 0, _WARM, _VARIANTS[0]
    yield np.zeros(problem.shape), 0, _COLD, _VARIANTS[0]


def _starts(problem: ConeProblem, effort: Effort) -> _Starts:
    """Yield what slower methods lead to."""
    x, shift = np.zeros(problem.shape), np.zeros(problem.shape[0])
    enough, tried = (1e-6 if problem.exact else 1e-13) * problem.scale, []
    for k in range(effort.rounds):
        outer, compliance = (6, 1.0) if k == 0 else (6, 1e-2) if problem.exact else (1, 10.0 ** -(5 + k))
        x, steps = augmented_lagrangian(problem, x, shift, outer=outer, enough=enough, compliance=compliance)
        tried.append(x)
        yield x, steps, _AFTER, _VARIANTS[k % len(_VARIANTS)]
        if problem.exact:
            u = problem.velocity(x)
            shift = np.sqrt(np.vecdot(u[:, 1:], u[:, 1:]))
    if problem.exact and effort.continued:
        x, steps = continuation(problem)
        tried.append(x)
        yield x, steps, 4 * _AFTER, _VARIANTS[0]
    if problem.exact:
        yield from _displaced(tried, effort.restarts)


def _displaced(tried: list[np.ndarray], restarts: int) -> _Starts:
    """Yield starts tried before, every other one displaced, for Newton's method with all kinds of variants."""
    rng = np.random.default_rng(0)
    for k in range(restarts):
        x = tried[rng.integers(len(tried))]
        size = np.abs(x).max() * 10.0 ** rng.uniform(-4.0, 0.0) * (k % 2)
        variant = 10.0 ** rng.uniform(-12.0, -6.0), 10.0 ** rng.uniform(-1.0, 1.0)
        yield project(x + size * rng.normal(size=x.shape)), 0, 30, variant
