"""The convex cone problem by augmented Lagrangians: slower than Newton's method on the complementarity, and safe."""

from __future__ import annotations

from math import sqrt

import numpy as np

from impactlaw import deferred
from impactlaw.solvers.friction.problem import ConeProblem, project, projection_derivative

_INNER = 60
_HALVINGS = 30
_ROUNDING = 3e-15  # of ``w / c``, relative to the scale of the problem over c
_LEAST = 1e-10  # c


def augmented_lagrangian(
    problem: ConeProblem, x: np.ndarray, shift: np.ndarray, *, outer: int, enough: float, compliance: float = 1.0
) -> tuple[np.ndarray, int]:
    """Solve ``K ∋ x ⊥ u + shift e_n ∈ K`` for a fixed shift, and return x and the number of Newton steps.

    With ``w = A z + b + shift e_n`` each round minimises the strictly convex
    ``|z|^2 / 2 + c |P_K(x - w / c)|^2 / 2`` over z by semismooth Newton steps with a line search, takes
    ``x = P_K(x - w / c)``, and divides c by ten.

    Args:
        problem: gives A and b, scaled.
        x: scaled impulse to start from, (h, m).
        shift: added to the normal velocities, (h,).
        outer: rounds.
        enough: residual, sqrt(J), at which to stop.
        compliance: first c; not below 1e-10.
    """
    A = problem.rows
    offset = problem.start.copy()
    offset[:, 0] += shift
    z = x.reshape(-1).dot(A)
    taken, c, least, last = 0, max(compliance, _LEAST), x, np.inf
    for _ in range(outer):
        z, steps = _minimize(A, offset, x, z, c, max(0.1 * enough, _ROUNDING * problem.scale / c))
        taken += steps
        x = project(x - (A.dot(z).reshape(x.shape) + offset) / c)
        w = A.dot(x.reshape(-1).dot(A)).reshape(x.shape) + offset
        error = float(np.linalg.norm(x - project(x - w)))
        if error < last:
            least, last = x, error
        if error <= enough:
            break
        c = max(0.1 * c, _LEAST)
    return least, taken


def _minimize(
    A: np.ndarray, offset: np.ndarray, x: np.ndarray, z: np.ndarray, c: float, enough: float
) -> tuple[np.ndarray, int]:
    """Minimise one augmented Lagrangian over z; return z and the steps taken."""
    h, m = x.shape
    nv = A.shape[1]

    def at(z: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        y = x - (A.dot(z).reshape(h, m) + offset) / c
        flat = project(y).reshape(-1)
        return y, 0.5 * z.dot(z) + 0.5 * c * flat.dot(flat), z - flat.dot(A)

    y, value, slope = at(z)
    steps = 0
    while steps < _INNER:
        size = sqrt(slope.dot(slope))
        if size <= enough:
            break
        D = projection_derivative(y)
        B = np.matmul(D, A.reshape(h, m, nv)).reshape(h * m, nv)
        H = A.T.dot(B) / c
        H.reshape(-1)[:: nv + 1] += 1.0
        _, step, failed = deferred.dposv(H, slope)
        if failed:
            step = slope
        decrease = slope.dot(step)
        fraction = 1.0
        steps += 1
        for _ in range(_HALVINGS):
            following = at(z - fraction * step)
            if following[1] <= value - 1e-4 * fraction * decrease:
                break
            if sqrt(following[2].dot(following[2])) < 0.5 * size:  # the value is rounding already
                break
            fraction *= 0.5
        else:
            break
        z = z - fraction * step
        y, value, slope = following
    return z, steps
