"""Lawson and Hanson's non-negative least squares: exact if some velocity has the wanted contact velocities.

C. L. Lawson and R. J. Hanson, *Solving Least Squares Problems*, 1974, ch. 23.
"""

from __future__ import annotations

import numpy as np
import scipy

from impactlaw.solvers.least_squares import least_squares
from impactlaw.solvers.problem import Problem, Solution, Status
from impactlaw.solvers.tolerances import IN_RANGE

_NNLS_CHANGES = 30  # largest number of changes of the active set per contact


def nnls(problem: Problem) -> Solution:
    """Solve ``min |Y^T Lambda - d|, Lambda >= 0``, which is the law's problem if ``Y d = c``.

    If d is not given, the one of least norm is computed. If the bound lies outside the range of Y, there is no d, and
    the status is ``Status.STOPPED`` (a dual active set solves such problems). Rows are first scaled to lengths from 1/2
    to 1, by powers of two, which causes no rounding.
    """
    d = problem.preimage
    if d is None:
        Y, c = problem.unit
        d = least_squares(Y, c)
        if np.abs(Y @ d - c).max(initial=0.0) > IN_RANGE * max(problem.scale, float(np.linalg.norm(d))):
            return Solution(np.zeros_like(c), Status.STOPPED)
    scale = np.ldexp(1.0, np.frexp(problem.lengths)[1])[:, None]
    try:
        impulse, _ = scipy.optimize.nnls((problem.gradients / scale).T, d, maxiter=_NNLS_CHANGES * len(scale))
    except RuntimeError:  # scipy raises it if these changes of the active set do not suffice
        return Solution(np.zeros_like(problem.bound), Status.STOPPED)
    return Solution(impulse / scale[:, 0])
