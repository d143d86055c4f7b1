"""Solve large islands of convex problems, without friction or with de Saxcé's correction held.

Newton's method mostly solves them in a few steps. If it fails, augmented Lagrangians come near the solution from any
point, and Newton's method starts again there.
"""

import numpy as np

from impactlaw.solvers.cones.algebra.loops import Array, copied, kernel, numbers, put
from impactlaw.solvers.cones.algebra.ordering import Blocks
from impactlaw.solvers.cones.algebra.structure import Island
from impactlaw.solvers.cones.convex import corrected
from impactlaw.solvers.cones.newton import CONVEX, newton

_STEPS, _PATIENCE = np.int64(10), np.int64(4)  # of Newton's method
_ONE, _PROXIMAL = np.int64(1), np.int64(8)  # number of convex problems, and of proximal steps
_DELTA = 1e-9  # least regularization
_NEAR = 1e2  # largest natural map of an accepted point, in tolerances


@kernel
def solve_large(P: Island, K: Blocks, x: Array, tolerance: float, most: int) -> tuple[int, float]:
    """Overwrite the guess x by the best point found; return steps taken and its natural map.

    `tolerance` is the natural map at which to stop. No proximal step begins after `most` Newton steps.
    """
    dense, one, none = numbers(0), 1.0, 0.0
    total, least = newton(P, K, dense, x, tolerance, _STEPS, CONVEX, one, _DELTA, none, _PATIENCE)
    if least <= _NEAR * tolerance or most <= total:
        return total, least
    point = copied(x)
    total += corrected(P, K, point, _NEAR * tolerance, _ONE, _PROXIMAL, most - total)
    taken, r = newton(P, K, dense, point, tolerance, _STEPS, CONVEX, one, _DELTA, none, _PATIENCE)
    if r < least:
        least = r
        put(x, point)
    return total + taken, least
