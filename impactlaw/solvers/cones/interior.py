"""An interior point method for ``K ∋ x  ⊥  u = A A^T x + c x + b + |u_t| e_n ∈ K``.

Here u includes de Saxcé's correction ``|u_t| e_n``; the convex relaxation omits it.

The method is primal-dual, with the scaling of Nesterov & Todd and the predictor and corrector of Mehrotra (Acary,
Armand & Nguyen 2023 for contact with friction). It needs no guess, and takes about as many steps as Newton's method
from a good guess. In degenerate problems, where friction is not unique or contacts only touch, a natural map of about
1e-4 remains.

Let W be the scaling of a group, ``W u = W^-1 x``, and t its direction of sliding. Then ``N = I - e_n t^T`` is the
derivative of the velocity without correction with respect to u. A step solves
``(G + c + N W^-2) dx = N W^-1 r - F``, which with ``E = (c + N W^-2)^-1`` becomes ``(I + A^T E A) dz = A^T E q``.
"""

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.blocks import assemble, back_substitute, factor, room
from impactlaw.solvers.cones.algebra.box_rows import (
    aim_boxes,
    begin_boxes,
    box_gap,
    box_push,
    box_reach,
    box_weight,
    follow_boxes,
)
from impactlaw.solvers.cones.algebra.linear import lu_factor, lu_solve_rows
from impactlaw.solvers.cones.algebra.loops import FIRST, FLOATS, Array, clear, indices, numbers, plain, put, zeros
from impactlaw.solvers.cones.algebra.ordering import BLOCKS, Blocks
from impactlaw.solvers.cones.algebra.projection import norm_of, project, residual
from impactlaw.solvers.cones.algebra.structure import BOX, CONE, ISLAND, Island, velocity

_BILATERAL = 1e-9  # least compliance of equality constraints
_SHORT = 0.99  # fraction of the way to the boundary of the cones
_PATIENCE = 3  # consecutive steps without an improvement of the natural map by 10 %, after which to stop
_BETTER = 0.9
_NEAR = 1e-1  # largest natural map of a guess, relative to velocities, from which the method starts


@plain
def _determinant(v: Array, o: int, e: int) -> float:
    r = norm_of(v, o + 1, e)
    return (v[o] - r) * (v[o] + r)


@plain
def _scaled(w: Array, o: int, e: int, eta: float, sign: float, v: Array, out: Array) -> None:
    """Write ``W v`` of a group to out, or, with ``1 / eta`` and the sign -1, ``W^-1 v``; out must not be v."""
    s = 0.0
    for k in range(o + 1, e):
        s += w[k] * v[k]
    out[o] = eta * (w[o] * v[o] + sign * s)
    f = sign * v[o] + s / (1.0 + w[o])
    for k in range(o + 1, e):
        out[k] = eta * (v[k] + f * w[k])


@plain
def _product(a: Array, b: Array, o: int, e: int, f: float, out: Array) -> None:
    """Add f times the Jordan product of a and b to out."""
    s = 0.0
    for k in range(o, e):
        s += a[k] * b[k]
    out[o] += f * s
    for k in range(o + 1, e):
        out[k] += f * (a[o] * b[k] + b[o] * a[k])


@plain
def _quotient(a: Array, o: int, e: int, d: Array) -> None:
    """Overwrite d by its quotient with a, the y for which d is the Jordan product of a and y."""
    s = 0.0
    for k in range(o + 1, e):
        s += a[k] * d[k]
    first = (a[o] * d[o] - s) / _determinant(a, o, e)
    d[o] = first
    for k in range(o + 1, e):
        d[k] = (d[k] - first * a[k]) / a[o]


@plain
def _scale(P: Island, g: int, x: Array, u: Array, w: Array, E: Array, B: Array, pivot: Array) -> float:
    """Write the scaling point w of a group, and E; return eta, the factor of the scaling W."""
    o, e, at = P.start[g], P.start[g + 1], P.square[g]
    m, a, b, s = e - o, np.sqrt(_determinant(x, o, e)), np.sqrt(_determinant(u, o, e)), 0.0
    for k in range(o, e):
        s += x[k] * u[k]
    f = 0.5 / np.sqrt(0.5 * (1.0 + s / (a * b)))
    for k in range(o, e):
        w[k] = f * (x[k] / a + (u[k] if k == o else -u[k]) / b)
    slip, compliant = norm_of(u, o + 1, e) if P.exact else 0.0, False
    for i in range(m):
        first = a / b * (2.0 * w[o + i] * w[o] - (1.0 if i == 0 else 0.0))
        for j in range(m):
            t = first
            if j > 0:
                t = a / b * (2.0 * w[o + i] * w[o + j] + (1.0 if i == j else 0.0))
                t += first * u[o + j] / slip if slip > 0.0 else 0.0
            E[at + i * m + j] = t
            B[i * m + j] = t * P.c[o + j] + (1.0 if i == j else 0.0)
        compliant = compliant or P.c[o + i] > 0.0
    if compliant:
        lu_factor(B, FIRST, m, pivot, FIRST)
        lu_solve_rows(B, FIRST, m, pivot, FIRST, E, at, m)
    return np.sqrt(a / b)


@plain
def _prepare(P: Island, x, u, high, v, F, w, eta, lam, E, B, pivot) -> None:
    """Write F, E and the scaling of each group for a step; v is the velocity without correction."""
    for g in range(len(P.kind)):
        o, e = P.start[g], P.start[g + 1]
        if P.kind[g] == CONE:
            eta[g] = _scale(P, g, x, u, w, E, B, pivot)
            _scaled(w, o, e, eta[g], 1.0, u, lam)
            for k in range(o, e):
                F[k] = v[k] - u[k]
            F[o] += norm_of(u, o + 1, e) if P.exact else 0.0
        elif P.kind[g] == BOX:
            E[P.square[g]] = box_weight(P.bound[g], P.c[o], x[o], u[o], high[o])
            F[o] = v[o] - u[o] + high[o]
        else:
            E[P.square[g]] = 1.0 / (P.c[o] + _BILATERAL)
            F[o] = v[o]


@plain
def _direction(P: Island, K: Blocks, x, u, high, F, w, eta, E, H, pivot, r, z, t, dx, du, dhigh) -> None:
    """Write the step with ``W^-1 dx + W du = r``; for boxes, r and w hold what `aim_boxes` writes."""
    for g in range(len(P.kind)):
        o, e = P.start[g], P.start[g + 1]
        if P.kind[g] == CONE:
            _scaled(w, o, e, 1.0 / eta[g], -1.0, r, t)
            s, slip = 0.0, norm_of(u, o + 1, e) if P.exact else 0.0
            for k in range(o + 1, e):
                s += u[k] * t[k]
            t[o] -= s / slip if slip > 0.0 else 0.0
        else:
            t[o] = box_push(P.bound[g], x[o], r[o], w[o]) if P.kind[g] == BOX else 0.0
        m, at = e - o, P.square[g]
        for k in range(o, e):
            t[k] -= F[k]
        for i in range(m):
            s = 0.0
            for j in range(m):
                s += E[at + i * m + j] * t[o + j]
            dx[o + i] = s
    back_substitute(P, K, E, H, pivot, z, t, dx)
    for g in range(len(P.kind)):
        o, e = P.start[g], P.start[g + 1]
        if P.kind[g] == CONE:
            _scaled(w, o, e, 1.0 / eta[g], -1.0, dx, t)
            for k in range(o, e):
                t[k] = r[k] - t[k]
            _scaled(w, o, e, 1.0 / eta[g], -1.0, t, du)
    follow_boxes(P, x, u, high, r, w, dx, du, dhigh)


@plain
def _reach(x: Array, d: Array, o: int, e: int) -> float:
    """Return the distance along d to the boundary of the cone, in lengths of d; 1e9 if d does not meet it."""
    a, c = d[o] ** 2 - norm_of(d, o + 1, e) ** 2, _determinant(x, o, e)
    b = x[o] * d[o]
    for k in range(o + 1, e):
        b -= x[k] * d[k]
    far = -x[o] / d[o] if d[o] < 0.0 else 1e9
    square = b * b - a * c
    if square < 0.0:
        return far
    q = -(b + np.sqrt(square)) if b >= 0.0 else np.sqrt(square) - b
    if q * a > 0.0:
        far = min(far, q / a)
    if q > 0.0:
        far = min(far, c / q)
    return far


@plain
def _length(P: Island, x, u, high, dx, du, dhigh) -> float:
    """Return the fraction of the step, at most 1, that stays inside all cones and boxes."""
    far = 1.0
    for g in range(len(P.kind)):
        if P.kind[g] == CONE:
            o, e = P.start[g], P.start[g + 1]
            far = min(far, _SHORT * _reach(x, dx, o, e), _SHORT * _reach(u, du, o, e))
        elif P.kind[g] == BOX:
            o = P.start[g]
            far = min(far, _SHORT * box_reach(P.bound[g], x[o], u[o], high[o], dx[o], du[o], dhigh[o]))
    return far


@plain
def _gap(P: Island, x, u, high, dx, du, dhigh, f: float) -> float:
    """Return the mean of ``x^T u`` of contacts and of the products of boxes, after a fraction f of the step."""
    s, count = 0.0, 0
    for g in range(len(P.kind)):
        if P.kind[g] == CONE:
            count += 1
            for k in range(P.start[g], P.start[g + 1]):
                s += (x[k] + f * dx[k]) * (u[k] + f * du[k])
        elif P.kind[g] == BOX:
            o = P.start[g]
            count += 2
            s += box_gap(P.bound[g], x[o] + f * dx[o], u[o] + f * du[o], high[o] + f * dhigh[o])
    return s / max(count, 1)


@plain
def _correct(P: Island, w, eta, lam, dx, du, center: float, r, t, p) -> None:
    """Write the right side r of the corrector step, which follows the central path, from the predictor step."""
    for g in range(len(P.kind)):
        if P.kind[g] == CONE:
            o, e = P.start[g], P.start[g + 1]
            for k in range(o, e):
                r[k] = 0.0
            r[o] = center
            _product(lam, lam, o, e, -1.0, r)
            _scaled(w, o, e, 1.0 / eta[g], -1.0, dx, t)
            _scaled(w, o, e, eta[g], 1.0, du, p)
            _product(t, p, o, e, -1.0, r)
            _quotient(lam, o, e, r)


@plain
def _begin(P: Island, x, v, r: float, size: float, t, point, u, high) -> None:
    """Write a starting point inside the cones, near the guess if its natural map r is small compared to velocities."""
    inside = size
    if r < _NEAR * size:
        inside = np.sqrt(r * size)
        for g in range(len(P.kind)):
            o = P.start[g]
            for k in range(o, P.start[g + 1]):
                t[k] = v[k]
            t[o] += norm_of(v, o + 1, P.start[g + 1]) if P.exact else 0.0
        project(P, x, point)
        project(P, t, u)
    else:
        clear(point)
        clear(u)
    for g in range(len(P.kind)):
        o = P.start[g]
        if P.kind[g] == CONE:
            point[o] += inside
            u[o] += inside
    begin_boxes(P, x, v, inside, inside < size, point, u, high)


@plain
def _advance(P: Island, K: Blocks, x, u, high, S, eta, E, H, pivot, z) -> None:
    """Take the step from x and u; H is factored, and S holds what `_prepare` has written, and scratch arrays."""
    F, w, lam, r, t, p, dx, du, dhigh = S[0], S[1], S[2], S[3], S[4], S[5], S[6], S[7], S[8]
    for k in range(len(x)):
        r[k] = -lam[k]
        dx[k] = 0.0
    aim_boxes(P, x, u, high, 0.0, dx, du, dhigh, r, w)
    _direction(P, K, x, u, high, F, w, eta, E, H, pivot, r, z, t, dx, du, dhigh)
    gap = _gap(P, x, u, high, dx, du, dhigh, 0.0)
    after = _gap(P, x, u, high, dx, du, dhigh, _length(P, x, u, high, dx, du, dhigh))
    center = gap * min(1.0, max(0.0, after / gap)) ** 3
    _correct(P, w, eta, lam, dx, du, center, r, t, p)
    aim_boxes(P, x, u, high, center, dx, du, dhigh, r, w)
    _direction(P, K, x, u, high, F, w, eta, E, H, pivot, r, z, t, dx, du, dhigh)
    f = _length(P, x, u, high, dx, du, dhigh)
    for k in range(len(x)):
        x[k] += f * dx[k]
        u[k] += f * du[k]
        high[k] += f * dhigh[k]


@linked(types.int64(ISLAND, BLOCKS, FLOATS, types.float64, types.float64, types.int64))
def interior(P: Island, K: Blocks, x: Array, size: float, tolerance: float, most: int) -> int:
    """Overwrite x by the best point of at most `most` steps; return steps taken.

    Args:
        P: the problem.
        K: storage of the matrix over the degrees of freedom.
        x: guess, overwritten.
        size: scale of the velocities.
        tolerance: natural map at which to stop.
        most: largest number of steps.
    """
    n, groups, rows = len(x), len(P.kind), 1
    for g in range(groups):
        rows = max(rows, P.start[g + 1] - P.start[g])
    point, u, high, v, S = numbers(n), numbers(n), zeros(n), numbers(n), zeros(9 * n).reshape((9, n))
    z, eta, E, H = numbers(P.nv), numbers(groups), numbers(P.square[groups]), numbers(K.size)
    pivot, left, row, B = indices(max(rows, P.nv)), numbers(room(P)), numbers(max(P.nv, 1)), numbers(rows * rows)
    velocity(P, P.b, x, z, v)
    least, fruitless, taken = np.inf, 0, 0
    _begin(P, x, v, residual(P, x, v, P.exact), size, S[0], point, u, high)
    velocity(P, P.b, point, z, v)
    while taken < most and least > tolerance and fruitless < _PATIENCE:
        _prepare(P, point, u, high, v, S[0], S[1], eta, S[2], E, B, pivot)
        assemble(P, K, E, H, left, row)
        factor(K, H, pivot, row)
        _advance(P, K, point, u, high, S, eta, E, H, pivot, z)
        taken += 1
        velocity(P, P.b, point, z, v)
        s = residual(P, point, v, P.exact)
        if not s < 1e100:
            break
        fruitless = 0 if s < _BETTER * least else fruitless + 1
        if s < least:
            least = s
            put(x, point)
    return taken
