"""The alternating direction method with a proximal term and a spectral penalty (Carpentier, Montaut, Le Lidec 2024).

``x`` minimizes the quadratic part, ``y`` is its projection, and ``w`` is the multiplier of ``x = y``, which converges
to the velocity. De Saxcé's correction is computed from the w of the previous step. The matrix ``G + c + rho`` is
inverted by the matrix ``H = I + A^T T A`` over the degrees of freedom, with the diagonal ``T = 1 / (c + rho)``
(Woodbury).
"""

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.blocks import assemble, factor, room, solve
from impactlaw.solvers.cones.algebra.loops import (
    FIRST,
    FLOATS,
    Array,
    clear,
    copied,
    fill,
    indices,
    numbers,
    once,
    plain,
    put,
    zeros,
)
from impactlaw.solvers.cones.algebra.ordering import BLOCKS, Blocks
from impactlaw.solvers.cones.algebra.projection import norm_of, project, residual
from impactlaw.solvers.cones.algebra.structure import CONE, ISLAND, Island, jump, rows_times, velocity

_PROXIMAL = 1e-8
_LEAST = 1e-6  # used in place of the least eigenvalue of G
_POWER = 0.3  # initial power in rho = sqrt(_LEAST L) (L / _LEAST)^power
_MOVE = 0.05  # change of the power
_FACTORIZATIONS = 25  # largest number of factorizations


@once
def largest_eigenvalue(P: Island) -> float:
    """Return an estimate of the largest eigenvalue of ``A A^T + c``, from 15 steps of the power method."""
    n = len(P.b)
    v, w, z = numbers(n), numbers(n), numbers(P.nv)
    zero, L = zeros(n), 0.0
    fill(v, FIRST, n, 1.0 / np.sqrt(n))
    for _ in range(15):
        velocity(P, zero, v, z, w)
        L = norm_of(w, FIRST, n)
        if not L > 0.0:
            break
        for i in range(n):
            v[i] = w[i] / L
    return max(L, 1e-9)


@plain
def _prepare(P: Island, K: Blocks, rho: float, W: Array, H: Array, pivot: Array, left: Array, row: Array) -> None:
    """Factor ``I + A^T T A``."""
    clear(W)
    for g in range(len(P.kind)):
        m = P.start[g + 1] - P.start[g]
        for k in range(m):
            W[P.square[g] + k * (m + 1)] = 1.0 / (P.c[P.start[g] + k] + rho)
    assemble(P, K, W, H, left, row)
    factor(K, H, pivot, row)


@plain
def _shift(P: Island, u: Array, v: Array, sign: float) -> None:
    """Add ``sign |u_t|`` to the normal entries of v if friction is exact."""
    if P.exact:
        for g in range(len(P.kind)):
            if P.kind[g] == CONE:
                v[P.start[g]] += sign * norm_of(u, P.start[g] + 1, P.start[g + 1])


@linked(types.int64(ISLAND, BLOCKS, types.float64, FLOATS, types.float64, types.int64))
def admm(P: Island, K: Blocks, L: float, x: Array, tolerance: float, most: int) -> int:
    """Overwrite x by the result of at most `most` steps from x; return steps taken.

    `L` is the largest eigenvalue of ``A A^T + c``; `tolerance` is the natural map at which to stop.
    """
    n, groups = len(x), len(P.kind)
    W, H, pivot = numbers(P.square[groups]), numbers(K.size), indices(max(n, P.nv))
    left, row = numbers(room(P)), numbers(max(P.nv, 1))
    y, w, p, t, z, u = copied(x), numbers(n), numbers(n), numbers(n), numbers(P.nv), numbers(n)
    g = numbers(n)
    point = copied(x)
    velocity(P, P.b, x, z, u)
    _shift(P, u, u, 1.0)
    project(P, u, w)
    for i in range(groups):
        if P.kind[i] != CONE:
            w[P.start[i]] = u[P.start[i]]
    power = _POWER
    rho = np.sqrt(_LEAST * L) * (L / _LEAST) ** power
    _prepare(P, K, rho + _PROXIMAL, W, H, pivot, left, row)
    count, last = 1, 0
    for k in range(most):
        for i in range(n):
            g[i] = _PROXIMAL * point[i] + rho * y[i] + w[i] - P.b[i]
        _shift(P, w, g, -1.0)
        for i in range(n):
            point[i] = g[i] / (P.c[i] + rho + _PROXIMAL)
        jump(P, point, z)
        solve(K, H, pivot, z)
        rows_times(P, z, t)
        primal = dual = 0.0
        for i in range(n):
            point[i] -= t[i] / (P.c[i] + rho + _PROXIMAL)
            t[i] = point[i] - w[i] / rho
        project(P, t, p)
        for i in range(n):
            dual = max(dual, rho * abs(p[i] - y[i]))
            y[i] = p[i]
            w[i] -= rho * (point[i] - y[i])
            primal = max(primal, abs(point[i] - y[i]))
        if k % 5 == 4:
            velocity(P, P.b, y, z, u)
            if residual(P, y, u, P.exact) <= tolerance:
                put(x, y)
                return k + 1
            if k - last >= 10 and count < _FACTORIZATIONS and (primal > 10.0 * dual or dual > 10.0 * primal):
                power += _MOVE if primal > 10.0 * dual else -_MOVE
                rho = np.sqrt(_LEAST * L) * (L / _LEAST) ** power
                _prepare(P, K, rho + _PROXIMAL, W, H, pivot, left, row)
                count += 1
                last = k
    put(x, y)
    return most
