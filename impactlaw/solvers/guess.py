"""Answers that cost little more than a look: right for the contacts of most small problems, to be certified.

Guesses at which contacts carry an impulse, all of them or those that did a step before, and one call of NNLS.
"""

from __future__ import annotations

import numpy as np

from impactlaw import deferred
from impactlaw.solvers.certificate import judge
from impactlaw.solvers.methods.nnls import cone_projection
from impactlaw.solvers.problem import Problem

_SMALL = 20  # contacts up to which NNLS is faster than several corrections of a first guess
_EXACT = 1e-12  # part of the scale of a problem that an expectation may miss
_INDEPENDENT = 1e-3  # sine of the angle between a gradient and the span of those before it, below which G loses digits
_CHANGES = 3, 0.25  # of the active contacts, at least and per contact, after which NNLS is faster
_DIFFERENT = 1e-4  # squared sine of the angle between two gradients, below which their determinant loses digits


def guess(problem: Problem) -> np.ndarray | None:
    """Return an impulse, shape (h,), that is likely to solve the problem; None if only a solver can tell.

    Two contacts have a closed form. NNLS answers for a few, with the law's own d or with ``d = Y^T G^-1 c``. For more,
    where G is not near singular, all contacts are taken for active, ``Lambda = G^-1 c``, and that is corrected.
    """
    Y, c, G = problem.gradients, problem.bound, problem.delassus
    h, nv = Y.shape
    point = problem.preimage if 2 < h <= _SMALL else None
    if point is None and h <= nv:
        if G is None:
            G = Y.dot(Y.T)
        if h == 2:
            return _pair(G.tolist(), c.tolist())
        factor, impulse, failed = deferred.dposv(G, c)
        if not failed and min((factor.diagonal() / problem.lengths).tolist()) >= _INDEPENDENT:
            if min(impulse.tolist()) > 0:
                return impulse
            found = None if h <= _SMALL else _active_set(G, c, impulse)
            if found is not None:
                return found
            point = impulse.dot(Y)
    if point is None:
        point = problem.preimage
    return None if point is None else cone_projection(problem, point)


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


def _active_set(G: np.ndarray, c: np.ndarray, impulse: np.ndarray) -> np.ndarray | None:
    """Return the impulse that solves ``Lambda >= 0  ⊥  G Lambda - c >= 0``, from ``G^-1 c`` on; None if not found.

    A primal-dual active set: contacts with ``Lambda_i <= 0`` leave, those with ``(G Lambda - c)_i < 0`` enter.
    """
    wanted = c.tolist()
    active = [i for i, value in enumerate(impulse.tolist()) if value > 0]
    for _ in range(max(_CHANGES[0], int(_CHANGES[1] * len(c)))):
        if not active:
            return None
        at = np.array(active)
        _, carried, failed = deferred.dposv(G.take(at, 0).take(at, 1), c.take(at))
        if failed:
            return None
        impulse = np.zeros(len(c))
        impulse[at] = carried
        reached = G.dot(impulse).tolist()
        following = [
            i for i, value in enumerate(impulse.tolist()) if value > 0 or (value == 0 and reached[i] < wanted[i])
        ]
        if following == active:
            return impulse
        active = following
    return None


def _pair(G: list[list[float]], c: list[float]) -> np.ndarray | None:
    """Return the impulses of two contacts, in Python's own numbers; None where they are nearly parallel."""
    (a, b), (_, d) = G
    one, other = c
    determinant = a * d - b * b
    if determinant <= _DIFFERENT * a * d:
        return None
    first, second = d * one - b * other, a * other - b * one
    if first > 0 and second > 0:
        return np.array([first / determinant, second / determinant])
    first, second = one / a, other / d
    if first > 0 and b * first >= other:
        return np.array([first, 0.0])
    return np.array([0.0, max(second, 0.0)])
