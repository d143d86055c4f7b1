"""The impulse of contacts that are expected to carry one, as they did a step before."""

from __future__ import annotations

import numpy as np

from impactlaw import deferred
from impactlaw.solvers.answer import judge
from impactlaw.solvers.base import Problem

_EXACT = 1e-12  # part of the scale of a problem that an expectation may miss
_INDEPENDENT = 1e-3  # sine of the angle between a gradient and the span of those before it, below which G loses digits


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
