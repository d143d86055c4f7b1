"""Nonsmooth Gauss-Seidel: the problem of each contact in turn is solved with the impulses of all others held.

(M. Jean, *The non-smooth contact dynamics method*, Comput. Methods Appl. Mech. Eng. 177, 1999.) The normal impulse of a
contact and its friction, a quadratic problem on a disc, are solved alternately until they agree. Exact friction only.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from impactlaw.solvers.cones import BILATERAL, BOX, CONE

from .problem import Problem

_TURNS = 10  # alternations between the normal impulse of a contact and its friction
_SECULAR = 40  # Newton steps for the multiplier of the disc
_ROUND = 1e-14
_EVERY = 5  # sweeps between two evaluations of the natural map
_kernel: Any = njit(cache=True, error_model="numpy")


class Arrays(NamedTuple):
    """The arrays of a `Problem`, with its rows in CSR form."""

    indptr: Any
    indices: Any
    data: Any
    nv: int
    first: Any
    size: Any
    kind: Any
    bound: Any
    compliance: Any
    offset: Any


def arrays(problem: Problem) -> Arrays:
    """Return the arrays of a problem."""
    rows = problem.rows
    return Arrays(
        rows.indptr, rows.indices, rows.data, rows.shape[1], problem.first, problem.size, problem.kind, problem.bound,
        problem.compliance, problem.offset,
    )  # fmt: skip


@_kernel
def sweep(P, x, enough, most):
    """Improve x in place, by at most `most` sweeps, until all natural maps are at most `enough`; return the sweeps."""
    block, values, vectors = _blocks(P)
    z, u, new = np.zeros(P.nv), np.zeros(P.size.max()), np.zeros(P.size.max())
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


@_kernel
def _row_add(P, i, factor, z):
    """Add the row i times a factor to z."""
    for a in range(P.indptr[i], P.indptr[i + 1]):
        z[P.indices[a]] += factor * P.data[a]


@_kernel
def _velocity(P, g, x, z, u):
    """Write the velocity of the group g into u, given ``z = Y^T x``."""
    for k in range(P.size[g]):
        i = P.first[g] + k
        u[k] = P.compliance[i] * x[i] + P.offset[i]
        for a in range(P.indptr[i], P.indptr[i + 1]):
            u[k] += P.data[a] * z[P.indices[a]]


@_kernel
def _blocks(P):
    """Return the Delassus matrix of each group, and the eigenvalues and eigenvectors of its tangential block."""
    groups, most = len(P.first), P.size.max()
    block, values = np.zeros((groups, most, most)), np.zeros((groups, most))
    vectors, work = np.zeros((groups, most, most)), np.zeros(P.nv)
    for g in range(groups):
        o, m = P.first[g], P.size[g]
        for k in range(m):
            _row_add(P, o + k, 1.0, work)
            for j in range(m):
                for a in range(P.indptr[o + j], P.indptr[o + j + 1]):
                    block[g, j, k] += P.data[a] * work[P.indices[a]]
            for a in range(P.indptr[o + k], P.indptr[o + k + 1]):
                work[P.indices[a]] = 0.0
            block[g, k, k] += P.compliance[o + k]
        if m > 1:
            values[g, 1:m], vectors[g, 1:m, 1:m] = np.linalg.eigh(block[g, 1:m, 1:m].copy())
    return block, values, vectors


@_kernel
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


@_kernel
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


@_kernel
def _natural_map(P, x, z, u):
    """Write ``z = Y^T x`` and return the largest natural map of a group."""
    z[:] = 0.0
    for i in range(len(x)):
        _row_add(P, i, x[i], z)
    worst = 0.0
    for g in range(len(P.first)):
        _velocity(P, g, x, z, u)
        o, m = P.first[g], P.size[g]
        worst = max(worst, _missed(P.kind[g], P.bound[g], x[o : o + m], u[:m]))
    return worst


@_kernel
def _missed(kind, bound, x, u):
    """Return the natural map of one group."""
    if kind == BILATERAL:
        return abs(u[0])
    if kind == BOX:
        return abs(x[0] - min(max(x[0] - u[0], -bound), bound))
    y = x - u
    y[0] -= np.sqrt((u[1:] ** 2).sum())
    length = np.sqrt((y[1:] ** 2).sum())
    if length > y[0]:
        normal = max(0.0, 0.5 * (y[0] + length))
        y[1:] *= normal / length
        y[0] = normal
    return np.sqrt(((x - y) ** 2).sum())
