"""The scaling W of Nesterov & Todd for one group: ``W u = W^-1 x``, with ``W = eta (2 w w^T - J)^(1/2)``.

J is the reflection of the tangential part, and w a vector with ``w^T J w = 1``.
"""

import numpy as np

from impactlaw.solvers.cones.algebra.linear import lu_factor, lu_solve_rows
from impactlaw.solvers.cones.algebra.loops import FIRST, Array, plain
from impactlaw.solvers.cones.algebra.projection import norm_of
from impactlaw.solvers.cones.algebra.structure import Island


@plain
def determinant(v: Array, o: int, e: int) -> float:
    """Return ``v^T J v`` of a group."""
    r = norm_of(v, o + 1, e)
    return (v[o] - r) * (v[o] + r)


@plain
def scaled(w: Array, o: int, e: int, eta: float, sign: float, v: Array, out: Array) -> None:
    """Write ``W v`` of a group to out, or, with ``1 / eta`` and the sign -1, ``W^-1 v``; out must not be v."""
    s = 0.0
    for k in range(o + 1, e):
        s += w[k] * v[k]
    out[o] = eta * (w[o] * v[o] + sign * s)
    f = sign * v[o] + s / (1.0 + w[o])
    for k in range(o + 1, e):
        out[k] = eta * (v[k] + f * w[k])


@plain
def add_product(a: Array, b: Array, o: int, e: int, f: float, out: Array) -> None:
    """Add f times the Jordan product of a and b to out."""
    s = 0.0
    for k in range(o, e):
        s += a[k] * b[k]
    out[o] += f * s
    for k in range(o + 1, e):
        out[k] += f * (a[o] * b[k] + b[o] * a[k])


@plain
def divide(a: Array, o: int, e: int, d: Array) -> None:
    """Overwrite d by its quotient with a, the y for which d is the Jordan product of a and y."""
    s = 0.0
    for k in range(o + 1, e):
        s += a[k] * d[k]
    first = (a[o] * d[o] - s) / determinant(a, o, e)
    d[o] = first
    for k in range(o + 1, e):
        d[k] = (d[k] - first * a[k]) / a[o]


@plain
def scaling(x: Array, u: Array, o: int, e: int, w: Array) -> float:
    """Write w of a group for x and u inside the cone; return eta."""
    a, b, s = np.sqrt(determinant(x, o, e)), np.sqrt(determinant(u, o, e)), 0.0
    for k in range(o, e):
        s += x[k] * u[k]
    f = 0.5 / np.sqrt(0.5 * (1.0 + s / (a * b)))
    for k in range(o, e):
        w[k] = f * (x[k] / a + (u[k] if k == o else -u[k]) / b)
    return np.sqrt(a / b)


@plain
def scale_rows(P: Island, g: int, w: Array, eta: float, rows: Array) -> None:
    """Write the rows ``W A`` of a group."""
    o, a, width, A = P.start[g], P.entry[g], P.begin[g + 1] - P.begin[g], P.A
    for j in range(a, a + width):
        rows[j] = 0.0
    for k in range(1, P.start[g + 1] - o):
        for j in range(a, a + width):
            rows[j] += w[o + k] * A[j + k * width]
    for k in range(1, P.start[g + 1] - o):
        for j in range(a, a + width):
            rows[j + k * width] = eta * (A[j + k * width] + w[o + k] * (A[j] + rows[j] / (1.0 + w[o])))
    for j in range(a, a + width):
        rows[j] = eta * (w[o] * A[j] + rows[j])


@plain
def slide(w: Array, o: int, e: int, u: Array, t: Array, p: Array) -> None:
    """Write the direction t of the tangential velocity of a group, and ``p = eta W^-1 t``; 0 if it does not slide."""
    slip = norm_of(u, o + 1, e)
    t[o] = 0.0
    for k in range(o + 1, e):
        t[k] = u[k] / slip if slip > 0.0 else 0.0
    scaled(w, o, e, 1.0, -1.0, t, p)


@plain
def weigh(
    P: Island, g: int, w: Array, eta: float, p: Array, t: Array, q: Array, E: Array, B: Array, pivot: Array
) -> None:
    """Write ``E = (I + Q W c W)^-1 Q`` of a group, with ``Q = I + w p^T``; t, q, B and pivot are scratch."""
    o, e, at = P.start[g], P.start[g + 1], P.square[g]
    m, compliant = e - o, False
    for i in range(m):
        compliant = compliant or P.c[o + i] > 0.0
        for j in range(m):
            E[at + i * m + j] = w[o + i] * p[o + j] + (1.0 if i == j else 0.0)
    if not compliant:
        return
    for j in range(m):
        for k in range(o, e):
            t[k] = 1.0 if k == o + j else 0.0
        scaled(w, o, e, eta, 1.0, t, q)
        s = 0.0
        for k in range(o, e):
            q[k] *= P.c[k]
        scaled(w, o, e, eta, 1.0, q, t)
        for k in range(o, e):
            s += p[k] * t[k]
        for i in range(m):
            B[i * m + j] = t[o + i] + w[o + i] * s + (1.0 if i == j else 0.0)
    lu_factor(B, FIRST, m, pivot, FIRST)
    lu_solve_rows(B, FIRST, m, pivot, FIRST, E, at, m)
