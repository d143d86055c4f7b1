"""Lawson and Hanson's non-negative least squares: exact where the wanted contact velocities are those of a velocity.

C. L. Lawson and R. J. Hanson, *Solving Least Squares Problems*, 1974, ch. 23.
"""

from __future__ import annotations

import numpy as np
import scipy

from impactlaw.solvers.least_squares import least_squares
from impactlaw.solvers.problem import Problem, Solution, Status
from impactlaw.solvers.tolerances import IN_RANGE

_NNLS_CHANGES = 30  # of the active set, per contact, at most


def nnls(problem: Problem) -> Solution:
    """Solve ``min |Y^T Lambda - d|, Lambda >= 0``, the law's problem whenever ``Y d = c``.

    Without a known d the least-norm one is computed; a bound outside of the range of Y has none, and the answer is
    ``Status.STOPPED`` (a dual active set solves those). Rows are scaled first, to lengths from 1/2 to 1, by powers of
    two, which rounds nothing.
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
    except RuntimeError:  # how scipy says that these changes of the active set were not enough
        return Solution(np.zeros_like(problem.bound), Status.STOPPED)
    return Solution(impulse / scale[:, 0])
