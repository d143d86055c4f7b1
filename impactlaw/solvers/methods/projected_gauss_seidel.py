"""Projected Gauss-Seidel, contact by contact: the method of most physics engines, for comparison."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.certificate import natural_residual
from impactlaw.solvers.problem import Problem, Solution, Status

_CHECKED = 10  # sweeps between two checks of the residual


def projected_gauss_seidel(problem: Problem, *, sweeps: int = 1000, tolerance: float = 1e-10) -> Solution:
    """Set ``Lambda_i`` to ``max(0, Lambda_i + (c_i - Y_i z) / G_ii)``, contact by contact, sweep after sweep.

    The iteration ends when the natural map, relative to the scale of the problem, is at most the tolerance. After the
    given number of sweeps the status is ``Status.STOPPED``, with the impulse reached.
    """
    U, c = problem.unit
    h, nv = U.shape
    if problem.is_sparse:
        cuts = U.indptr[1:-1]
        rows = list(zip(np.split(U.indices, cuts), np.split(U.data, cuts), strict=True))
    else:
        rows = [(slice(None), row) for row in U]
    wanted = c.tolist()
    scaled, z, residual, done = [0.0] * h, np.zeros(nv), 0.0, 0
    for done in range(1, sweeps + 1):
        for i, (where, row) in enumerate(rows):
            change = max(wanted[i] - row @ z[where], -scaled[i])
            if change != 0.0:
                scaled[i] += change
                z[where] += change * row
        if done % _CHECKED == 0 or done == sweeps:
            residual = natural_residual(problem, np.array(scaled) / problem.lengths)
            if residual <= tolerance:
                return Solution(np.array(scaled) / problem.lengths, Status.SOLVED, done, residual)
    return Solution(np.array(scaled) / problem.lengths, Status.STOPPED, done, residual)
