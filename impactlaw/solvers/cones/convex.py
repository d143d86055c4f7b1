"""Solve the convex problem with de Saxcé's correction held, by augmented Lagrangians, and iterate on the correction.

With the correction s held (``b + s e_n`` in place of b), the problem is the optimality condition of
``min |A^T x|^2 / 2 + c |x|^2 / 2 + b^T x, x in the sets``. A proximal step with the compliance kappa minimizes
``|z|^2 / 2 + sum kappa (y^T P(y) - |P(y)|^2 / 2)`` over z by Newton's method with a line search. Here
``y = (q x - A z - b) / kappa`` for each group, kappa is larger than the compliance c of the group, and
``q = kappa - c``. The new x is P(y). The correction is the fixed point ``s = |u_t|``, found with Anderson's
acceleration (Acary & Brogliato 2008, section 13.7, and Acary & Cadoux 2013 for the fixed point; Walker & Ni 2011).
"""

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.blocks import assemble, factor, room, solve
from impactlaw.solvers.cones.algebra.linear import lu_factor, lu_solve
from impactlaw.solvers.cones.algebra.loops import (
    FIRST,
    FLOATS,
    Array,
    copied,
    indices,
    kernel,
    numbers,
    plain,
    put,
    zeros,
)
from impactlaw.solvers.cones.algebra.ordering import BLOCKS, Blocks
from impactlaw.solvers.cones.algebra.projection import norm_of, project, projection_derivative, residual, slips
from impactlaw.solvers.cones.algebra.structure import BOX, ISLAND, Island, jump, rows_times, velocity

_START, _END = 1e-1, 1e-6  # compliance of the first and of the last proximal step
_STEPS = 50  # largest number of Newton steps of one proximal step
_MEMORY = 5  # number of earlier points that the acceleration uses
_EXACT = np.bool_(False)  # the convex problem has no exact friction
_FAR = 1e3  # change of velocity, relative to the scale of the problem, that does not occur in practice
_COMPLIANCES = np.array([1e-2, 1e-4, 1e-6, 1e-8, 1e-8])  # of the proximal steps that search for a nearer velocity
_ROUNDING = 1e-12  # relative rounding error of the product of impulse and offset


@plain
def _envelope(P: Island, y: Array, p: Array, kappa: Array) -> float:
    """Write ``p = P(y)``; return the sum of ``kappa (y^T p - |p|^2 / 2)``."""
    project(P, y, p)
    s = 0.0
    for g in range(len(P.kind)):
        t = 0.0
        for i in range(P.start[g], P.start[g + 1]):
            t += (y[i] - 0.5 * p[i]) * p[i]
        s += kappa[g] * t
    return s


@linked(types.int64(ISLAND, BLOCKS, FLOATS, FLOATS, FLOATS, types.float64, types.float64, FLOATS, FLOATS))
def proximal_step(
    P: Island, K: Blocks, b: Array, x: Array, z: Array, least: float, tolerance: float, W: Array, H: Array
) -> int:
    """Overwrite x by the next proximal point, starting from z, and z by its jump; return Newton steps.

    The compliance of the step is that of each group plus `least`; `tolerance` is that of the gradient.
    """
    n, groups, nv = len(x), len(P.kind), P.nv
    kappa, most_rows = numbers(groups), 1
    y, p, yt, pt, w = numbers(n), numbers(n), numbers(n), numbers(n), numbers(n)
    gradient, step, zt, gt = numbers(nv), numbers(nv), numbers(nv), numbers(nv)
    pivot, left, row = indices(max(n, nv)), numbers(room(P)), numbers(max(nv, 1))
    rows_times(P, z, w)
    for g in range(groups):
        kappa[g] = 0.0
        for i in range(P.start[g], P.start[g + 1]):
            kappa[g] = max(kappa[g], P.c[i])
        kappa[g] += least
        for i in range(P.start[g], P.start[g + 1]):
            y[i] = ((kappa[g] - P.c[i]) * x[i] - w[i] - b[i]) / kappa[g]
        most_rows = max(most_rows, P.start[g + 1] - P.start[g])
    D = numbers(most_rows**2).reshape((most_rows, most_rows))
    value = 0.5 * norm_of(z, FIRST, nv) ** 2 + _envelope(P, y, p, kappa)
    taken = 0
    while taken < _STEPS:
        jump(P, p, gradient)
        for i in range(nv):
            gradient[i] = z[i] - gradient[i]
            step[i] = gradient[i]
        length = norm_of(gradient, FIRST, nv)
        if length <= tolerance:
            break
        for g in range(groups):
            m, at = P.start[g + 1] - P.start[g], P.square[g]
            projection_derivative(P.kind[g], P.bound[g], y, P.start[g], m, D)
            for i in range(m):
                for j in range(m):
                    W[at + i * m + j] = D[i, j] / kappa[g]
        assemble(P, K, W, H, left, row)
        factor(K, H, pivot, row)
        solve(K, H, pivot, step)
        taken += 1
        decrease = 0.0
        for i in range(nv):
            decrease += gradient[i] * step[i]
        rows_times(P, step, w)
        f, ok, new = 1.0, False, value
        for _ in range(30):
            for g in range(groups):
                for i in range(P.start[g], P.start[g + 1]):
                    yt[i] = y[i] + f * w[i] / kappa[g]
            for i in range(nv):
                zt[i] = z[i] - f * step[i]
            new = 0.5 * norm_of(zt, FIRST, nv) ** 2 + _envelope(P, yt, pt, kappa)
            if new <= value - 1e-4 * f * decrease:
                ok = True
                break
            jump(P, pt, gt)
            for i in range(nv):
                gt[i] -= zt[i]
            if norm_of(gt, FIRST, nv) < 0.5 * length:
                ok = True
                break
            f *= 0.5
        if not ok:
            break
        put(z, zt)
        put(y, yt)
        put(p, pt)
        value = new
    put(x, p)
    return taken


@kernel
def held(P: Island, K: Blocks, b: Array, x: Array, tolerance: float, outer: int, most: int, W: Array, H: Array) -> int:
    """Overwrite x by the best point of `outer` proximal steps on the convex problem with the offset b.

    No proximal step begins after `most` Newton steps. Return the Newton steps taken.
    """
    n = len(x)
    point, z, u, size = copied(x), numbers(P.nv), numbers(n), 0.0
    for i in range(n):
        size = max(size, abs(b[i]))
    jump(P, x, z)
    taken, bad, low, least = 0, 0, np.inf, _START
    for _ in range(outer):
        if taken >= most:
            break
        taken += proximal_step(P, K, b, point, z, least, max(0.1 * tolerance, 3e-15 * size / least), W, H)
        velocity(P, b, point, z, u)
        r = residual(P, point, u, _EXACT)
        if r < low:
            low, bad = r, 0
            put(x, point)
        else:
            bad += 1
        if r <= tolerance or bad >= 2:
            break
        least = max(0.1 * least, _END)
    return taken


@plain
def _separates(P: Island, x: Array, z: Array, scale: float) -> bool:
    """Return whether an impulse x proves that no velocity within reach lies in the dual cones.

    For x in the cones and every solution y, ``x^T (A (A^T y) + C y + b) >= 0``, and therefore
    ``|(A^T y, sqrt(C) y)| >= -b^T x / |(A^T x, sqrt(C) x)|``. Box rows, whose velocity is free, are ignored: their
    entries of x are set to 0.
    """
    given = square = 0.0
    for g in range(len(P.kind)):
        for i in range(P.start[g], P.start[g + 1]):
            if P.kind[g] == BOX:
                x[i] = 0.0
            given -= P.b[i] * x[i]
            square += P.c[i] * x[i] * x[i]
    jump(P, x, z)
    moved = np.sqrt(square + norm_of(z, FIRST, P.nv) ** 2)
    return given > scale * (_FAR * moved + _ROUNDING * norm_of(x, FIRST, len(x)))


@linked(types.Tuple((types.int64, types.boolean))(ISLAND, BLOCKS, types.float64))
def out_of_reach(P: Island, K: Blocks, scale: float) -> tuple[int, bool]:
    """Return Newton steps taken, and whether the convex problem has no solution, or one that is too far away.

    Solvability of the convex problem is the criterion of V. Acary, F. Cadoux, C. Lemaréchal and J. Malick (ZAMM 91,
    2011) for the existence of impulses with exact friction. Without it there is no indication that such impulses exist;
    jammed bodies are of this kind. The impulse added by a proximal step is tested as a proof (G. Banjac, P. Goulart,
    B. Stellato and S. Boyd, J. Optim. Theory Appl. 183, 2019). The total impulse would not reveal a small jam beside
    larger collisions elsewhere.
    """
    n = len(P.b)
    x, before, added, y, z = zeros(n), numbers(n), numbers(n), numbers(n), zeros(P.nv)
    W, H, proof, taken = numbers(P.square[len(P.kind)]), numbers(K.size), numbers(P.nv), 0
    for least in _COMPLIANCES:
        put(before, x)
        taken += proximal_step(P, K, P.b, x, z, least, scale * max(1e-10, 3e-15 / least), W, H)
        for i in range(n):
            added[i] = x[i] - before[i]
        project(P, added, y)
        if _separates(P, y, proof, scale):
            return taken, True
    return taken, False


@kernel
def _accelerated(S: Array, F: Array, count: int, new: Array) -> None:
    """Write the next point of Anderson's acceleration from the last `count` points S and their fixed-point steps F."""
    q, h = count - 1, len(new)
    N, right, pivot = zeros(q * q), zeros(q), indices(q)
    trace = 0.0
    for i in range(q):
        for k in range(h):
            right[i] += (F[i + 1, k] - F[i, k]) * F[q, k]
        for j in range(q):
            for k in range(h):
                N[i * q + j] += (F[i + 1, k] - F[i, k]) * (F[j + 1, k] - F[j, k])
        trace += N[i * (q + 1)]
    for i in range(q):
        N[i * (q + 1)] += 1e-12 * trace + 1e-300
    lu_factor(N, FIRST, q, pivot, FIRST)
    lu_solve(N, FIRST, q, pivot, FIRST, right, FIRST)
    for k in range(h):
        s = S[q, k] + F[q, k]
        for i in range(q):
            s -= (S[i + 1, k] - S[i, k] + F[i + 1, k] - F[i, k]) * right[i]
        new[k] = max(s, 0.0)


@linked(types.int64(ISLAND, BLOCKS, FLOATS, types.float64, types.int64, types.int64, types.int64))
def corrected(P: Island, K: Blocks, x: Array, tolerance: float, sweeps: int, outer: int, most: int) -> int:
    """Overwrite x by the best solution of `sweeps` convex problems, each with a new correction; return Newton steps.

    Each problem has at most `outer` proximal steps. None of them begins after a total of `most` Newton steps.
    """
    n, groups = len(x), len(P.kind)
    s, new, b, u, z = zeros(groups), numbers(groups), numbers(n), numbers(n), numbers(P.nv)
    points = _MEMORY + 1
    S, F = zeros(points * groups).reshape((points, groups)), zeros(points * groups).reshape((points, groups))
    count = 0
    W, H = numbers(P.square[groups]), numbers(K.size)
    best, least, taken = copied(x), np.inf, 0
    velocity(P, P.b, x, z, u)
    if P.exact and norm_of(x, FIRST, n) > 0.0:
        slips(P, u, s)
    for _ in range(sweeps):
        for i in range(n):
            b[i] = P.b[i]
        for g in range(groups):
            b[P.start[g]] += s[g]
        taken += held(P, K, b, x, 0.1 * tolerance, outer, most - taken, W, H)
        velocity(P, P.b, x, z, u)
        r = residual(P, x, u, P.exact)
        if r < least:
            least = r
            put(best, x)
        if r <= tolerance or not P.exact or taken >= most:
            break
        slips(P, u, new)
        if count > _MEMORY:
            for j in range(_MEMORY):
                put(S[j], S[j + 1])
                put(F[j], F[j + 1])
            count = _MEMORY
        for g in range(groups):
            S[count, g], F[count, g] = s[g], new[g] - s[g]
        count += 1
        if count > 1:
            _accelerated(S, F, count, new)
        put(s, new)
    put(x, best)
    return taken
