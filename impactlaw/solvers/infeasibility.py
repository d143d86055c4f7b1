"""Prove that a law has no solution."""

from __future__ import annotations

import numpy as np
import scipy

from impactlaw.solvers.problem import Problem
from impactlaw.solvers.tolerances import NO_IMPULSE, RAY_BALANCED, RAY_CONFLICT, RAY_OPEN, RAY_ROUNDING


def farkas_ray(problem: Problem) -> np.ndarray | None:
    """Return ``nu >= 0`` with ``Y^T nu = 0`` and ``c^T nu > 0``, a proof that ``Y z >= c`` has no solution, or None.

    The ray is minimal: without one of its contacts it proves nothing. Its largest entry is 1.
    """
    Y, c = problem.unit
    size = float(c.max(initial=0.0))
    if size <= 0.0:
        return None
    c = c / size
    wanted = np.append(np.zeros(Y.shape[1]), 1.0)
    try:
        found, _ = scipy.optimize.nnls(np.vstack([Y.T, c]), wanted, maxiter=30 * len(c))
    except RuntimeError:
        return None
    scale = problem.scale / size
    for ray in (_vanishing(Y, c, found > 0), found):
        unbalanced, conflict = float(np.linalg.norm(ray @ Y)), float(ray @ c)
        agreed = max(RAY_CONFLICT, RAY_ROUNDING * scale) * float(ray.sum())
        if conflict > max(agreed, RAY_OPEN * scale * unbalanced) and unbalanced <= RAY_BALANCED * float(ray.sum()):
            ray = ray / problem.lengths
            return ray / ray.max()
    return None


def _vanishing(Y: np.ndarray, c: np.ndarray, support: np.ndarray) -> np.ndarray:
    """Return the positive part of the vanishing combination of these gradients, of which NNLS leaves at most one."""
    ray = np.zeros(len(c))
    nu = scipy.linalg.svd(Y[support].T, check_finite=False)[2][-1]
    ray[support] = np.maximum(nu if nu @ c[support] > 0 else -nu, 0.0)
    ray[ray < NO_IMPULSE * ray.max()] = 0.0
    return ray
