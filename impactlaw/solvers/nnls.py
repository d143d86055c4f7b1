"""Lawson and Hanson's non-negative least squares: exact where the wanted contact velocities are those of a velocity."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lstsq
from scipy.optimize import nnls as scipy_nnls

from impactlaw.solvers.base import Problem, Solution, Status

_IN_RANGE = 1e-12  # relative distance from the range of Y that counts as rounding


def nnls(problem: Problem) -> Solution:
    """Solve ``min |Y^T Lambda - d|, Lambda >= 0``, the law's problem whenever ``Y d = c``.

    Without a known d the least-norm one is computed; a bound outside of the range of Y has none, and the answer is
    ``Status.STOPPED`` (a dual active set solves those).
    """
    d = problem.preimage
    if d is None:
        d = lstsq(problem.gradients, problem.bound, lapack_driver="gelsd", check_finite=False)[0]
        error = np.abs(problem.gradients @ d - problem.bound)
        if (error > _IN_RANGE * (np.abs(problem.bound) + problem.norms * np.linalg.norm(d))).any():
            return Solution(np.zeros_like(problem.bound), Status.STOPPED)
    return cone_projection(problem.gradients, d, problem.norms)


def cone_projection(gradients: np.ndarray, point: np.ndarray, norms: np.ndarray) -> Solution:
    """``min |Y^T Lambda - point|, Lambda >= 0`` with the rows of Y scaled to unit length first."""
    scale = np.where(norms > 0, norms, 1.0)
    try:
        scaled, _ = scipy_nnls((gradients / scale[:, None]).T, point)
    except RuntimeError:  # scipy's way to say that the iteration limit was reached
        return Solution(np.zeros(len(gradients)), Status.STOPPED)
    return Solution(scaled / scale)
