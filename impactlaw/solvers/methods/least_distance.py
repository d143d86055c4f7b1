"""Lawson and Hanson's least-distance form by NNLS, scaled to keep its accuracy: slow but reliable, for any bound.

C. L. Lawson and R. J. Hanson, *Solving Least Squares Problems*, 1974, ch. 23, problem LDP.
"""

from __future__ import annotations

import numpy as np
import scipy

from impactlaw.solvers.problem import Problem, Solution, Status
from impactlaw.solvers.tolerances import FARTHEST_JUMP

_PASSES = 8


def least_distance(problem: Problem) -> Solution:
    """Solve ``min |z|, Y z >= c`` by ``min |Y^T u|^2 + (c^T u / t - 1)^2, u >= 0`` with t near ``|z|``.

    A pass with a wrong t loses accuracy by a factor ``(|z| / t)^2``. Therefore each pass uses the ``|z|`` of the pass
    before as t. A residual of zero at the largest t means that u is a Farkas ray: the law has no solution.
    """
    Y, c = problem.unit
    h, nv = Y.shape
    wanted = np.append(np.zeros(nv), 1.0)
    t = float(c.max(initial=0.0))
    if t <= 0.0:
        return Solution(np.zeros(h))
    farthest = FARTHEST_JUMP * problem.scale
    for done in range(1, _PASSES + 1):
        try:
            u, _ = scipy.optimize.nnls(np.vstack([Y.T, c / t]), wanted, maxiter=30 * h)
        except RuntimeError:
            return Solution(np.zeros(h), Status.STOPPED, done)
        z = u @ Y
        left = 1.0 - u @ c / t  # residual of the last row; equal to |residual|^2 if u is exact
        if left < 1e-6:  # |z| is more than a thousand times t
            if t >= farthest:
                return Solution(np.zeros(h), Status.INFEASIBLE, done)
            t = min(1e3 * t, farthest)
            continue
        far = t * float(np.linalg.norm(z)) / left
        if 0.1 * t < far < 10.0 * t:
            return Solution(u * (t / left) / problem.lengths, Status.SOLVED, done)
        if far == 0.0:
            break
        t = far
    return Solution(np.zeros(h), Status.STOPPED, _PASSES)
