"""Lawson and Hanson's non-negative least squares: exact where the wanted contact velocities are those of a velocity.

C. L. Lawson and R. J. Hanson, *Solving Least Squares Problems*, 1974, ch. 23.
"""

from __future__ import annotations

import numpy as np

from impactlaw import deferred
from impactlaw.solvers.least_squares import least_squares
from impactlaw.solvers.problem import Problem, Solution, Status

_IN_RANGE = 1e-12  # distance from the range of Y, relative to the scale of the problem, that counts as rounding
_CHANGES = 3, 30  # of the active set, per contact, at most: in a first and in a second try
_BALANCED = 4.0  # ratio of lengths up to which scaling changes nothing


def nnls(problem: Problem) -> Solution:
    """Solve ``min |Y^T Lambda - d|, Lambda >= 0``, the law's problem whenever ``Y d = c``.

    Without a known d the least-norm one is computed; a bound outside of the range of Y has none, and the answer is
    ``Status.STOPPED`` (a dual active set solves those).
    """
    d = problem.preimage
    if d is None:
        Y, c = problem.gradients / problem.lengths[:, None], problem.bound / problem.lengths
        d = least_squares(Y, c)
        if np.abs(Y @ d - c).max(initial=0.0) > _IN_RANGE * max(problem.scale, float(np.linalg.norm(d))):
            return Solution(np.zeros_like(c), Status.STOPPED)
    impulse = cone_projection(problem, d)
    return Solution(np.zeros_like(problem.bound), Status.STOPPED) if impulse is None else Solution(impulse)


def cone_projection(problem: Problem, point: np.ndarray) -> np.ndarray | None:
    """Return the minimiser of ``|Y^T Lambda - point|, Lambda >= 0``, None where NNLS does not end.

    Rows of Y of very different length are scaled to unit length first.
    """
    values = problem.lengths.tolist()
    if not values:
        return np.zeros(0)
    balanced = max(values) <= _BALANCED * min(values)
    columns = problem.gradients.T if balanced else problem.gradients.T / problem.lengths
    for changes in _CHANGES:
        impulse, _, ended = deferred.unchecked_nnls(columns, point, changes * len(values))
        if ended == deferred.ENDED:
            return impulse if balanced else impulse / problem.lengths
    return None
