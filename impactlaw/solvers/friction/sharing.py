"""Share the impulse among redundant contacts with friction: of all solutions, take the impulse of least norm."""

from __future__ import annotations

import numpy as np
import scipy

from impactlaw.solvers.friction.problem import ConeProblem, project, projection_derivative
from impactlaw.solvers.sparsity import components

_TINY = 1e-300
_LEAST = 1e-6  # lower limit of the diagonal of G, at most 1, whose inverse is the step of the map
_RANK = 1e-9  # relative singular value of the derivative below which contacts are redundant
_FEW = 8  # number of contacts up to which it is not worth searching for uncoupled groups
_SHARED = 1e-12  # relative residual that a shared impulse may have


def share(problem: ConeProblem, x: np.ndarray, residual: float) -> np.ndarray:
    """Return the scaled impulse of least norm with which contacts stick, slide or are open as with x.

    Newton's equation at x, ``F'(x) (y - x) = -F(x)``, has many solutions y if G is singular; the one of least norm is
    computed, separately for each group of coupled contacts, in a time that grows with the cube of the group's size.

    Returns:
        The impulse of least norm, (h, m); x itself if that impulse is not a solution, for example outside the cones.
    """
    value, system = _linearized(problem, x)
    wanted = system.dot(x.reshape(-1)) - value.reshape(-1)
    least = np.empty(x.size)
    for part in _parts(problem):
        whole = len(part) == x.size
        one = system if whole else system[np.ix_(part, part)]
        least[part] = scipy.linalg.lstsq(one, wanted[part], cond=_RANK)[0]
    least = least.reshape(x.shape)
    reached = problem.residual(least, problem.velocity(least))
    return least if reached <= max(10.0 * residual, _SHARED * problem.scale) else x


def _parts(problem: ConeProblem) -> list[np.ndarray]:
    """Return the rows of contacts, group by group; contacts of different groups are not coupled by G."""
    h, m = problem.shape
    rows = np.arange(h * m)
    if h <= _FEW:
        return [rows]
    groups = components((problem.delassus != 0.0).reshape(h, m, h, m).any(axis=(1, 3)))
    return [rows.reshape(h, m)[group].ravel() for group in groups]


def _linearized(problem: ConeProblem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return F, (h, m), and F', (h m, h m), of a map that is zero if and only if the complementarity holds.

    ``F = x - P(x - R u)`` and ``F' = 1 - D + D R G`` with a projection P, its derivative D, and the inverse diagonal R
    of G. For exact friction P is that of P. Alart and A. Curnier (Comput. Methods Appl. Mech. Eng. 92, 1991): the
    normal part is projected onto the half line, and the tangential part onto the disk with the normal part as radius.
    For the relaxation, P is the projection onto the cone.
    """
    h, m = problem.shape
    u = problem.velocity(x)
    diagonal = np.maximum(problem.delassus.diagonal().reshape(h, m), _LEAST)
    if problem.exact:
        steps = np.repeat(1.0 / diagonal[:, 1:].max(axis=1, initial=_LEAST, keepdims=True), m, axis=1)
        steps[:, 0] = 1.0 / diagonal[:, 0]
        projected, D = _on_disks(x - steps * u)
    else:
        steps = np.repeat(1.0 / diagonal.max(axis=1, keepdims=True), m, axis=1)
        y = x - steps * u
        projected, D = project(y), projection_derivative(y)
    system = np.matmul(D * steps[:, None, :], problem.delassus.reshape(h, m, h * m)).reshape(h, m, h, m)
    i = np.arange(h)
    system[i, :, i, :] += np.eye(m) - D
    return x - projected, system.reshape(h * m, h * m)


def _on_disks(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``(N, y_t)``, (h, m), with ``N = max(y_n, 0)``, ``|y_t|`` limited to N, and its derivative, (h, m, m)."""
    h, m = y.shape
    N, q = np.maximum(y[:, 0], 0.0), y[:, 1:]
    r = np.sqrt(np.vecdot(q, q))
    cut = N / np.maximum(np.maximum(r, N), _TINY)
    direction = np.where(r > N, 1.0 / np.maximum(r, _TINY), 0.0)[:, None] * q  # zero for sticking contacts
    projected, D = np.empty((h, m)), np.zeros((h, m, m))
    projected[:, 0], projected[:, 1:] = N, cut[:, None] * q
    D[:, 0, 0] = N > 0
    D[:, 1:, 0] = direction * (N > 0)[:, None]
    D[:, 1:, 1:] = cut[:, None, None] * (np.eye(m - 1) - direction[:, :, None] * direction[:, None, :])
    return projected, D
