"""Guesses at which contacts carry an impulse: all of them, or those that did a step before. Neither is sure to hold."""

from __future__ import annotations

import numpy as np

from impactlaw import deferred
from impactlaw.solvers.answer import judge
from impactlaw.solvers.base import Problem

_EXACT = 1e-12  # part of the scale of a problem that an expectation may miss
_INDEPENDENT = 1e-3  # sine of the angle between a gradient and the span of those before it, below which G loses digits
_DIFFERENT = 1e-4  # squared sine of the angle between two gradients, below which their determinant loses digits
_FEW = 4  # contacts up to which Python's own numbers are faster than a call of NNLS
_CHANGES = 4


def guess(problem: Problem) -> np.ndarray | None:
    """Return ``Lambda = G^-1 c``, shape (h,), if all of it is positive; None if the guess is wrong or G near singular.

    The diagonal of the factor of G over the lengths of the gradients is the sine of the angle between each gradient
    and the span of those before it. Up to four contacts get further guesses.
    """
    Y, c = problem.gradients, problem.bound
    G = Y.dot(Y.T)
    if len(c) == 2:
        return _active_set(G.tolist(), c.tolist(), [0, 1])
    factor, impulse, failed = deferred.dposv(G, c)
    if failed:
        return None
    values = impulse.tolist()
    if min(values) <= 0:
        active = [i for i, value in enumerate(values) if value > 0]
        return _active_set(G.tolist(), c.tolist(), active) if len(values) <= _FEW else None
    if min((factor.diagonal() / problem.lengths).tolist()) < _INDEPENDENT:
        return None
    return impulse


def with_active(problem: Problem, active: np.ndarray) -> np.ndarray | None:
    """Return ``Lambda`` with ``(Y z - c)_A = 0``, zero elsewhere, if it solves the problem; None if it does not.

    Args:
        problem: what to solve.
        active: the contacts A, bool (h,).
    """
    rows = np.flatnonzero(active)
    if len(rows) == 0:
        return None
    Y = problem.gradients[rows]
    factor, carried, failed = deferred.dposv(Y.dot(Y.T), problem.bound[rows])
    if failed or min(carried.tolist()) <= 0:
        return None
    if min((factor.diagonal() / problem.lengths[rows]).tolist()) < _INDEPENDENT:
        return None
    impulse = np.zeros_like(problem.bound)
    impulse[rows] = carried
    return impulse if judge(problem, impulse).residual <= _EXACT * problem.scale else None


def _active_set(G: list[list[float]], c: list[float], active: list[int]) -> np.ndarray | None:
    """A primal-dual active set in Python's own numbers."""
    for _ in range(_CHANGES):
        carried = _solve(G, c, active)
        if carried is None:
            return None
        following = [i for i, value in zip(active, carried, strict=True) if value > 0]
        for i, row in enumerate(G):
            if i not in active:
                reached = 0.0
                for j, value in zip(active, carried, strict=True):
                    reached += row[j] * value
                if reached < c[i]:
                    following.append(i)
        if following == active:
            impulse = np.zeros(len(c))
            impulse[active] = carried
            return impulse
        active = sorted(following)
    return None


def _solve(G: list[list[float]], c: list[float], active: list[int]) -> list[float] | None:
    """Solve ``G Lambda = c`` on the active contacts by elimination; None where they are nearly dependent."""
    if len(active) == 1:
        return [c[active[0]] / G[active[0]][active[0]]]
    if len(active) == 2:
        i, k = active
        a, b, d = G[i][i], G[i][k], G[k][k]
        determinant = a * d - b * b
        if determinant <= _DIFFERENT * a * d:
            return None
        return [(d * c[i] - b * c[k]) / determinant, (a * c[k] - b * c[i]) / determinant]
    rows = [[G[i][j] for j in active] + [c[i]] for i in active]
    n = len(rows)
    for k, row in enumerate(rows):
        if row[k] <= _INDEPENDENT**2 * G[active[k]][active[k]]:
            return None
        for below in rows[k + 1 :]:
            factor = below[k] / row[k]
            for j in range(k + 1, n + 1):
                below[j] -= factor * row[j]
    impulse = [0.0] * n
    for k in range(n - 1, -1, -1):
        row = rows[k]
        impulse[k] = (row[n] - sum([row[j] * impulse[j] for j in range(k + 1, n)])) / row[k]
    return impulse
