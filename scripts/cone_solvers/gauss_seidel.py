"""Nonsmooth Gauss-Seidel: the problem of each contact in turn is solved with the impulses of all others held.

(M. Jean, *The non-smooth contact dynamics method*, Comput. Methods Appl. Mech. Eng. 177, 1999.) The normal impulse of a
contact and its friction, a quadratic problem on a disc, are solved alternately until they agree. Exact friction only.
"""

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.solvers.cones import BOX, CONE
from impactlaw.solvers.cones.algebra.projection import group_residual
from impactlaw.solvers.cones.rows import impulse_jump

_TURNS = 10  # alternations between the normal impulse of a contact and its friction
_SECULAR = 40  # Newton steps for the multiplier of the disc
_ROUND = 1e-14
_EVERY = 5  # sweeps between two evaluations of the natural map


@compiled()
def sweep(P, x, enough, most):
    """Improve x in place, by at most `most` sweeps, until all natural maps are at most `enough`; return the sweeps.

    P is a `rows.Problem` with exact friction.
    """
    block, values, vectors = _blocks(P)
    z, u, new = np.zeros(len(P.tree)), np.zeros(P.size.max()), np.zeros(P.size.max())
    for taken in range(most):
        if taken % _EVERY == 0 and _natural_map(P, x, z, u) <= enough:
            return taken
        for g in range(len(P.first)):
            o, m = P.first[g], P.size[g]
            _velocity(P, g, x, z, u)
            for k in range(m):
                new[k] = x[o + k]
                for j in range(m):
                    u[k] -= block[g, k, j] * x[o + j]
            if P.kind[g] == CONE:
                _contact(block[g], values[g], vectors[g], m, u, new)
            elif block[g, 0, 0] > 0.0:
                new[0] = -u[0] / block[g, 0, 0]
                if P.kind[g] == BOX:
                    new[0] = min(max(new[0], -P.bound[g]), P.bound[g])
            for k in range(m):
                _row_add(P, o + k, new[k] - x[o + k], z)
                x[o + k] = new[k]
    return most


@compiled()
def _row_add(P, i, factor, z):
    """Add the row i times a factor to z."""
    for a in range(P.rowadr[i], P.rowadr[i] + P.rownnz[i]):
        z[P.colind[a]] += factor * P.value[a]


@compiled()
def _row_times(P, i, z):
    """Return the product of the row i and z."""
    total = 0.0
    for a in range(P.rowadr[i], P.rowadr[i] + P.rownnz[i]):
        total += P.value[a] * z[P.colind[a]]
    return total


@compiled()
def _velocity(P, g, x, z, u):
    """Write the velocity of the group g into u, given ``z = Y^T x``."""
    for k in range(P.size[g]):
        i = P.first[g] + k
        u[k] = P.compliance[i] * x[i] + P.b[i] + _row_times(P, i, z)


@compiled()
def _blocks(P):
    """Return the Delassus matrix of each group, and the eigenvalues and eigenvectors of its tangential block."""
    groups, most = len(P.first), P.size.max()
    block, values = np.zeros((groups, most, most)), np.zeros((groups, most))
    vectors, work = np.zeros((groups, most, most)), np.zeros(len(P.tree))
    for g in range(groups):
        o, m = P.first[g], P.size[g]
        for k in range(m):
            _row_add(P, o + k, 1.0, work)
            for j in range(m):
                block[g, j, k] = _row_times(P, o + j, work)
            work[:] = 0.0
            block[g, k, k] += P.compliance[o + k]
        if m > 1:
            values[g, 1:m], vectors[g, 1:m, 1:m] = np.linalg.eigh(block[g, 1:m, 1:m].copy())
    return block, values, vectors


@compiled()
def _contact(block, values, vectors, m, q, x):
    """Solve one contact, ``u = G x + q``, in place, from its last impulse x."""
    pull, size = np.zeros(m), 0.0
    for _ in range(_TURNS):
        before, along = x[0], q[0]
        for k in range(1, m):
            along += block[0, k] * x[k]
        x[0] = max(0.0, -along / block[0, 0]) if block[0, 0] > 0.0 else 0.0
        for k in range(1, m):
            pull[k] = q[k] + block[k, 0] * x[0]
        _on_disc(values, vectors, m, pull, x[0], x)
        size = max(size, x[0])
        if m == 1 or abs(x[0] - before) <= _ROUND * size:
            return


@compiled()
def _on_disc(values, vectors, m, pull, radius, x):
    """Write into x[1:m] the minimizer of ``x^T G x / 2 + pull^T x`` with ``|x| <= radius``."""
    turned, s = np.zeros(m), 0.0
    x[1:m] = 0.0
    if radius == 0.0:
        return
    for k in range(1, m):
        s = max(s, _ROUND * values[k])
        for j in range(1, m):
            turned[k] += vectors[j, k] * pull[j]
    for _ in range(_SECULAR):
        square, slope = 0.0, 0.0
        for k in range(1, m):
            if turned[k] != 0.0:
                part = (turned[k] / (values[k] + s)) ** 2
                square += part
                slope += part / (values[k] + s)
        length = np.sqrt(square)
        if length <= radius * (1.0 + _ROUND):
            break
        s += square / slope * (length - radius) / radius
    for k in range(1, m):
        if turned[k] != 0.0:
            for j in range(1, m):
                x[j] -= vectors[j, k] * turned[k] / (values[k] + s)


@compiled()
def _natural_map(P, x, z, u):
    """Write ``z = Y^T x`` and return the largest natural map of a group."""
    impulse_jump(P.rownnz, P.rowadr, P.colind, P.value, x, z)
    worst = 0.0
    for g in range(len(P.first)):
        _velocity(P, g, x, z, u)
        o, m = P.first[g], P.size[g]
        worst = max(worst, group_residual(P.kind[g], P.bound[g], x[o : o + m], u, 0, m, P.exact))
    return np.sqrt(worst)
