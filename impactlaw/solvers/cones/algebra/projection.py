"""Projection onto the sets of the groups, and the natural map, whose zeros are the solutions.

Exact Coulomb friction after de Saxcé & Feng (1998) is ``K ∋ x  ⊥  u + |u_t| e_n ∈ K``, that is
``x = P_K(x - u - |u_t| e_n)``; the convex relaxation omits ``|u_t| e_n``.
"""

import numpy as np

from impactlaw.solvers.cones.algebra.loops import Array, plain
from impactlaw.solvers.cones.algebra.structure import BILATERAL, BOX, CONE, Island


@plain
def norm_of(v: Array, start: int, stop: int) -> float:
    """Return ``|v[start:stop]|``."""
    s = 0.0
    for k in range(start, stop):
        s += v[k] * v[k]
    return np.sqrt(s)


@plain
def project(P: Island, y: Array, p: Array) -> None:
    """Write the projection of y onto the sets of all groups."""
    for g in range(len(P.kind)):
        o, e, kind = P.start[g], P.start[g + 1], P.kind[g]
        if kind == CONE:
            a, r = y[o], norm_of(y, o + 1, e)
            if r <= a:
                n, f = a, 1.0
            elif r <= -a:
                n, f = 0.0, 0.0
            else:
                n = 0.5 * (a + r)
                f = n / r
            p[o] = n
            for k in range(o + 1, e):
                p[k] = f * y[k]
        elif kind == BOX:
            p[o] = min(max(y[o], -P.bound[g]), P.bound[g])
        else:
            p[o] = y[o]


@plain
def group_residual(kind: int, bound: float, x: Array, u: Array, o: int, e: int, exact: bool) -> float:
    """Return the squared length of the natural map of the group with rows o to e - 1."""
    s = 0.0
    if kind == BILATERAL:
        return u[o] * u[o]
    if kind == BOX:
        return (x[o] - min(max(x[o] - u[o], -bound), bound)) ** 2
    slip = norm_of(u, o + 1, e) if exact else 0.0
    a, r = x[o] - u[o] - slip, 0.0
    for k in range(o + 1, e):
        r += (x[k] - u[k]) ** 2
    r = np.sqrt(r)
    if r <= a:
        s = (u[o] + slip) ** 2
        for k in range(o + 1, e):
            s += u[k] * u[k]
    elif r <= -a:
        for k in range(o, e):
            s += x[k] * x[k]
    else:  # computed from u; computed from x, it would hide errors of u below the rounding errors of large impulses
        f = 0.5 * (r - a) / r
        s = (u[o] + slip - f * r) ** 2
        for k in range(o + 1, e):
            s += (u[k] + f * (x[k] - u[k])) ** 2
    return s


@plain
def residual(P: Island, x: Array, u: Array, exact: bool) -> float:
    """Return the length of the natural map; infinite if it is NaN."""
    s = 0.0
    for g in range(len(P.kind)):
        s += group_residual(P.kind[g], P.bound[g], x, u, P.start[g], P.start[g + 1], exact)
    return np.sqrt(s) if s >= 0.0 else np.inf


@plain
def slips(P: Island, u: Array, s: Array) -> None:
    """Write de Saxcé's correction ``|u_t|`` of each group; 0 for groups that are not cones."""
    for g in range(len(P.kind)):
        s[g] = norm_of(u, P.start[g] + 1, P.start[g + 1]) if P.kind[g] == CONE else 0.0


@plain
def projection_derivative(kind: int, bound: float, y: Array, o: int, m: int, D: Array) -> None:
    """Write a generalized derivative of the projection of the group of m rows from o; eigenvalues are in [0, 1]."""
    for k in range(m):
        for j in range(m):
            D[k, j] = 0.0
    if kind != CONE:
        D[0, 0] = 1.0 if kind == BILATERAL or abs(y[o]) <= bound else 0.0
        return
    a, r = y[o], norm_of(y, o + 1, o + m)
    if r <= a:
        for k in range(m):
            D[k, k] = 1.0
    elif r > -a:
        q = 0.5 * a / r
        D[0, 0] = 0.5
        for k in range(1, m):
            t = y[o + k] / r
            D[0, k] = D[k, 0] = 0.5 * t
            for j in range(1, m):
                D[k, j] = -q * t * y[o + j] / r
            D[k, k] += 0.5 + q
