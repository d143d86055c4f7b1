"""OSQP, a widely used operator splitting method for quadratic programs, for comparison.

B. Stellato, G. Banjac, P. Goulart, A. Bemporad and S. Boyd, Math. Program. Comput. 12, 2020.
"""

from __future__ import annotations

import numpy as np
import scipy

from impactlaw.solvers.certificate import natural_residual
from impactlaw.solvers.problem import Problem, Solution, Status

_OSQP_INFEASIBLE = (3, 4)  # osqp's status values: primal infeasible, and primal infeasible inaccurate


def osqp(problem: Problem, *, tolerance: float = 1e-9, iterations: int = 10_000, polish: bool = True) -> Solution:
    """Solve ``min |z|^2 / 2, Y z >= c`` by OSQP, with rows scaled to unit length and bounds scaled to size one.

    Args:
        problem: the problem to solve.
        tolerance: OSQP's absolute and relative tolerance.
        iterations: number of iterations after which the status is ``Status.STOPPED``, with the impulse reached.
        polish: whether OSQP solves again on the constraints that it found active.
    """
    import osqp as package

    Y, c = problem.unit
    size = float(np.abs(c).max(initial=0.0))
    if size == 0.0:
        return Solution(np.zeros_like(c))
    nv = Y.shape[1]
    solver = package.OSQP()
    solver.setup(
        scipy.sparse.csc_matrix(scipy.sparse.eye_array(nv)),
        np.zeros(nv),
        scipy.sparse.csc_matrix(Y),
        c / size,
        np.full(len(c), np.inf),
        verbose=False,
        eps_abs=tolerance,
        eps_rel=tolerance,
        max_iter=iterations,
        polishing=polish,
    )
    found = solver.solve(raise_error=False)
    count = int(found.info.iter)
    if int(found.info.status_val) in _OSQP_INFEASIBLE:
        return Solution(np.zeros_like(c), Status.INFEASIBLE, count)
    if found.y is None or not np.isfinite(found.y).all():
        return Solution(np.zeros_like(c), Status.STOPPED, count)
    impulse = np.maximum(-found.y, 0.0) * size / problem.lengths
    status = Status.SOLVED if found.info.status_val == 1 else Status.STOPPED
    return Solution(impulse, status, count, natural_residual(problem, impulse))
