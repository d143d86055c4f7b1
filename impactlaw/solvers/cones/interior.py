"""An interior point method for ``K ∋ x  ⊥  u = A A^T x + c x + b + |u_t| e_n ∈ K``.

Here u includes de Saxcé's correction ``|u_t| e_n``; the convex relaxation omits it.

The method is primal-dual, with the scaling of Nesterov & Todd and the predictor and corrector of Mehrotra (Acary,
Armand & Nguyen 2023 for contact with friction). It needs no guess, and takes 10 to 20 steps, or up to 50 in degenerate
problems, where friction is not unique or contacts only touch. Of these, a natural map of 1e-8 to 1e-6 remains.

Let W be the scaling of a group, ``W u = W^-1 x``, and t its direction of sliding. Then ``N = I - e_n t^T`` is the
derivative of the velocity without correction with respect to u. A step solves
``(G + c + N W^-2) dx = N W^-1 r - F``. In terms of ``y = W^-1 dx``, and with the scaled rows ``W A``,
``Q = W N^-1 W^-1`` and ``E = (I + Q W c W)^-1 Q``, this is ``(I + A^T W E W A) dz = A^T W E q`` and
``y = E (q - W A dz)``. Without these scaled rows, digits are lost when x and u come near the boundary of their cones.
Then ``du = N^-1 (F + A dz + c dx)``, so that F vanishes with full steps.

The problem with correction is not monotone, and steps may become short far from a solution. From then on the slip
``|u_t|`` is held in each step, N = I, which makes the problem of the step convex.
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
from impactlaw.solvers.cones.algebra.loops import FLOATS, Array, clear, indices, numbers, plain, put, zeros
from impactlaw.solvers.cones.algebra.ordering import BLOCKS, Blocks
from impactlaw.solvers.cones.algebra.projection import norm_of, project, residual
from impactlaw.solvers.cones.algebra.scaling import (
    add_product,
    determinant,
    divide,
    scale_rows,
    scaled,
    scaling,
    slide,
    weigh,
)
from impactlaw.solvers.cones.algebra.structure import BOX, CONE, ISLAND, Island, rows_times, velocity

_BILATERAL = 1e-9  # least compliance of equality constraints
_SHORT, _LONG = 0.9, 0.999  # least and largest fraction of the way to the boundary of the cones
_STUCK = 0.3  # length of a step from which on the slip is held
_PATIENCE = 16  # consecutive steps without an improvement of the natural map by 10 %, after which to stop
_BETTER = 0.9
_NEAR = 1e-1  # largest natural map of a guess, relative to velocities, from which the method starts


@plain
def _prepare(P: Island, x, u, high, v, S, eta, E, B, pivot, rows, follows) -> None:
    """Write F, E, the scaling of each group and its scaled rows for a step; v is the velocity without correction.

    Either the derivative of the slip `follows` it, or the slip is held.
    """
    F, w, lam, p, t = S[0], S[1], S[2], S[3], S[5]
    for g in range(len(P.kind)):
        o, e = P.start[g], P.start[g + 1]
        if P.kind[g] == CONE:
            eta[g] = scaling(x, u, o, e, w)
            for k in range(o, e):
                F[k], p[k] = v[k] - u[k], 0.0
            if P.exact:
                F[o] += norm_of(u, o + 1, e)
            if follows:
                slide(w, o, e, u, t, p)
            weigh(P, g, w, eta[g], p, t, S[6], E, B, pivot)
            scale_rows(P, g, w, eta[g], rows)
            scaled(w, o, e, eta[g], 1.0, u, lam)
            continue
        for j in range(P.entry[g], P.entry[g + 1]):
            rows[j] = P.A[j]
        if P.kind[g] == BOX:
            E[P.square[g]] = box_weight(P.bound[g], P.c[o], x[o], u[o], high[o])
            F[o] = v[o] - u[o] + high[o]
        else:
            E[P.square[g]] = 1.0 / (P.c[o] + _BILATERAL)
            F[o] = v[o]


@plain
def _direction(P: Island, R: Island, K: Blocks, x, u, high, S, eta, E, H, pivot, z, follows) -> None:
    """Write the step with ``W^-1 dx + W du = r``; for boxes, r and w hold what `aim_boxes` writes."""
    F, w, p, r, t, d, dx, du, dhigh = S[0], S[1], S[3], S[4], S[5], S[6], S[7], S[8], S[9]
    for g in range(len(P.kind)):
        o, e, at = P.start[g], P.start[g + 1], P.square[g]
        m = e - o
        if P.kind[g] == CONE:
            scaled(w, o, e, eta[g], 1.0, F, t)
            s = 0.0
            for k in range(o, e):
                s += p[k] * r[k]
            for k in range(o, e):
                t[k] = r[k] - w[k] * s - t[k]
        else:
            t[o] = (box_push(P.bound[g], x[o], r[o], w[o]) if P.kind[g] == BOX else 0.0) - F[o]
        for i in range(m):
            s = 0.0
            for j in range(m):
                s += E[at + i * m + j] * t[o + j]
            d[o + i] = s
    back_substitute(R, K, E, H, pivot, z, t, d)
    rows_times(P, z, du)
    for g in range(len(P.kind)):
        o, e = P.start[g], P.start[g + 1]
        if P.kind[g] == CONE:
            scaled(w, o, e, eta[g], 1.0, d, dx)
            for k in range(o, e):
                du[k] += F[k] + P.c[k] * dx[k]
            s, slip = 0.0, norm_of(u, o + 1, e) if follows else 0.0
            for k in range(o + 1, e):
                s += u[k] * du[k]
            du[o] += s / slip if slip > 0.0 else 0.0
        else:
            dx[o], du[o] = d[o], 0.0
    follow_boxes(P, x, u, high, r, w, dx, du, dhigh)


@plain
def _reach(x: Array, d: Array, o: int, e: int) -> float:
    """Return the distance along d to the boundary of the cone, in lengths of d; 1e9 if d does not meet it."""
    a, c = d[o] ** 2 - norm_of(d, o + 1, e) ** 2, determinant(x, o, e)
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
def _length(P: Island, x, u, high, dx, du, dhigh, short: float) -> float:
    """Return the fraction of the step, at most 1, that stays inside all cones and boxes."""
    far = 1.0
    for g in range(len(P.kind)):
        if P.kind[g] == CONE:
            o, e = P.start[g], P.start[g + 1]
            far = min(far, short * _reach(x, dx, o, e), short * _reach(u, du, o, e))
        elif P.kind[g] == BOX:
            o = P.start[g]
            far = min(far, short * box_reach(P.bound[g], x[o], u[o], high[o], dx[o], du[o], dhigh[o]))
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
            add_product(lam, lam, o, e, -1.0, r)
            scaled(w, o, e, 1.0 / eta[g], -1.0, dx, t)
            scaled(w, o, e, eta[g], 1.0, du, p)
            add_product(t, p, o, e, -1.0, r)
            divide(lam, o, e, r)


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
def _advance(P: Island, R: Island, K: Blocks, x, u, high, S, eta, E, H, pivot, z, follows) -> float:
    """Take the step from x and u; H is factored, and S holds what `_prepare` has written, and scratch arrays."""
    w, lam, r, t, p, dx, du, dhigh = S[1], S[2], S[4], S[5], S[6], S[7], S[8], S[9]
    for k in range(len(x)):
        r[k] = -lam[k]
        dx[k] = 0.0
    aim_boxes(P, x, u, high, 0.0, dx, du, dhigh, r, w)
    _direction(P, R, K, x, u, high, S, eta, E, H, pivot, z, follows)
    gap = _gap(P, x, u, high, dx, du, dhigh, 0.0)
    after = _gap(P, x, u, high, dx, du, dhigh, _length(P, x, u, high, dx, du, dhigh, 1.0))
    center = gap * min(1.0, max(0.0, after / gap)) ** 3
    _correct(P, w, eta, lam, dx, du, center, r, t, p)
    aim_boxes(P, x, u, high, center, dx, du, dhigh, r, w)
    _direction(P, R, K, x, u, high, S, eta, E, H, pivot, z, follows)
    f = _length(P, x, u, high, dx, du, dhigh, min(_LONG, max(_SHORT, 1.0 - after / gap)))
    for k in range(len(x)):
        x[k] += f * dx[k]
        u[k] += f * du[k]
        high[k] += f * dhigh[k]
    return f


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
    point, u, high, v, S = numbers(n), numbers(n), zeros(n), numbers(n), zeros(10 * n).reshape((10, n))
    z, eta, E, H = numbers(P.nv), numbers(groups), numbers(P.square[groups]), numbers(K.size)
    pivot, left, row, B = indices(max(rows, P.nv)), numbers(room(P)), numbers(max(P.nv, 1)), numbers(rows * rows)
    WA = numbers(len(P.A))
    R = Island(P.start, P.kind, P.bound, P.c, P.b, P.begin, P.cols, P.entry, WA, P.square, P.nv, P.exact)
    velocity(P, P.b, x, z, v)
    least, fruitless, taken, follows = np.inf, 0, 0, P.exact
    _begin(P, x, v, residual(P, x, v, P.exact), size, S[0], point, u, high)
    velocity(P, P.b, point, z, v)
    while taken < most and least > tolerance and fruitless < _PATIENCE:
        _prepare(P, point, u, high, v, S, eta, E, B, pivot, WA, follows)
        assemble(R, K, E, H, left, row)
        factor(K, H, pivot, row)
        follows = _advance(P, R, K, point, u, high, S, eta, E, H, pivot, z, follows) > _STUCK and follows
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
