"""A dual active set method (daqp) on the velocity form, for any bound, also one that no velocity reaches exactly.

D. Arnström, A. Bemporad and D. Axehill, IEEE Trans. Automat. Contr. 67, 2022.
"""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.problem import Problem, Solution, Status
from impactlaw.solvers.tolerances import DAQP_DUAL, DAQP_PRIMAL, RAY_ROUNDING

_DAQP_INFEASIBLE = -1  # daqp's exit flag


def dual_active_set(problem: Problem) -> Solution:
    """Solve ``min |z|^2 / 2, Y z >= c`` by daqp, with rows scaled to unit length and bounds scaled to size one."""
    import daqp

    Y, c = problem.unit
    size = float(np.abs(c).max(initial=0.0))
    if size == 0.0:
        return Solution(np.zeros_like(c))
    h, nv = Y.shape
    _, _, flag, info = daqp.solve(
        np.eye(nv),
        np.zeros(nv),
        np.ascontiguousarray(Y),
        np.full(h, 1e30),
        c / size,
        np.zeros(h, dtype=np.int32),
        # at least the rounding errors of c, which must not make the problem infeasible
        primal_tol=max(DAQP_PRIMAL, RAY_ROUNDING * problem.scale / size),
        dual_tol=DAQP_DUAL,
        iter_limit=100 * (h + nv),
    )
    if flag <= 0:  # then the multipliers are uninitialized memory
        status = Status.INFEASIBLE if flag == _DAQP_INFEASIBLE else Status.STOPPED
        return Solution(np.zeros_like(c), status, info["iterations"])
    return Solution(np.maximum(0.0 - info["lam"], 0.0) * size / problem.lengths, Status.SOLVED, info["iterations"])
