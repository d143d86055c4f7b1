"""A single contact in compiled code: open, sticking, or sliding along a line, as in `friction.single_contact`."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.friction.single_contact import SINGULAR, STEEP

_NO_ROW = 1e-13  # length and velocity of a row, relative to the normal's, up to which nothing can move along it


@plain
def _delassus(rows, chosen, n, work, G):
    """Write ``Y Y^T``, (n, n), of chosen rows into G, (3, 3); work is scratch space, zeros before and after, (nv,)."""
    for r in range(n):
        i = chosen[r]
        for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
            work[rows.col[a]] = rows.val[a]
        for q in range(r + 1):
            s, k = 0.0, chosen[q]
            for a in range(rows.adr[k], rows.adr[k] + rows.nnz[k]):
                s += rows.val[a] * work[rows.col[a]]
            G[3 * r + q] = G[3 * q + r] = s
        for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
            work[rows.col[a]] = 0.0


@plain
def _choose(rows, first, count, b, chosen):
    """Write the rows along which bodies can move and return their number; 0 if another row has a nonzero velocity."""
    n, normal = 0, 0.0
    for i in range(first, first + count):
        square = 0.0
        for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
            square += rows.val[a] * rows.val[a]
        if i == first:
            normal = square
        if square > _NO_ROW * _NO_ROW * normal or i == first:
            chosen[n], n = i, n + 1
        elif abs(b[i]) > _NO_ROW * abs(b[first]):
            return 0
    return n


@plain
def _sticks(G, b, n, L, y):
    """Write ``y = -G^-1 b``, n <= 3, and the Cholesky factor L of G; return whether G is regular and y in the cone."""
    for i in range(n):
        for k in range(i + 1):
            s = G[3 * i + k]
            for j in range(k):
                s -= L[3 * i + j] * L[3 * k + j]
            if k < i:
                L[3 * i + k] = s / L[4 * k]
            elif s > SINGULAR * G[4 * i]:
                L[4 * i] = np.sqrt(s)
            else:
                return False
    for i in range(n):
        s = -b[i]
        for k in range(i):
            s -= L[3 * i + k] * y[k]
        y[i] = s / L[4 * i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            y[i] -= L[3 * k + i] * y[k]
        y[i] /= L[4 * i]
    size = 0.0
    for i in range(1, n):
        size += y[i] * y[i]
    return size <= y[0] * y[0] and y[0] >= 0.0


@plain
def _slides(G, b, y):
    """Write the impulse, (2,), of a contact that slides along a line; return whether it does."""
    for d in (1.0, -1.0):  # direction of sliding
        D = G[0] - d * G[1]
        y[0] = -b[0] / D
        y[1] = -d * y[0]
        if d * (b[1] + G[1] * y[0] + G[4] * y[1]) >= 0.0:
            return True
    return False


@plain
def solve_alone(rows, first, count, b, chosen, room, x, z):
    """Write the impulses and velocity jump of a contact of at most 3 rows; return whether there is a closed form.

    There is none if it slides in a plane, or if friction is so large that there may be several solutions.

    Args:
        rows: the whitened rows.
        first: first row of the contact.
        count: number of its rows.
        b: velocities less the target velocities, (n,).
        chosen: scratch space for its rows, int64 (3,).
        room: scratch space, (24,).
        x: impulses, zeros before, (n,), written.
        z: velocity jump, zeros before, (nv,), written.
    """
    if b[first] >= 0.0:
        return True
    offset, y, G, L = room[:3], room[3:6], room[6:15], room[15:24]
    n = _choose(rows, first, count, b, chosen)
    _delassus(rows, chosen, n, z, G)
    side = 0.0
    for r in range(1, n):
        side += G[r] * G[r]
    if n == 0 or not G[0] > 0.0 or side > STEEP * STEEP * G[0] * G[0]:
        return False
    for r in range(n):
        offset[r] = b[chosen[r]]
    if not _sticks(G, offset, n, L, y) and not (n == 2 and _slides(G, offset, y)):
        return False
    for r in range(n):
        i = chosen[r]
        x[i] = y[r]
        for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
            z[rows.col[a]] += y[r] * rows.val[a]
    return True
