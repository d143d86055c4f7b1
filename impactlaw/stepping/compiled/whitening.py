"""Coordinates in which the kinetic metric is Euclidean, by MuJoCo's sparse factor ``M = L^T D L``."""

from __future__ import annotations

from typing import NamedTuple

from numba import types

from impactlaw.solvers.cones.algebra.loops import FLOATS, Array, plain

_ROUNDING = 1e-12  # smallest entries of J, m or m/rad: limbs that overlap at their common joint cannot be moved apart


class Inertia(NamedTuple):
    """A mass matrix ``M = L^T D L`` in MuJoCo's layout."""

    factor: Array  # L, strictly lower part of rows as in MuJoCo's M
    inverse: Array  # ``1 / D``, (nv,)
    nnz: Array  # number of entries of each row of M, (nv,)
    adr: Array  # index of the first entry of each row, (nv,)
    col: Array  # column of each entry, the diagonal last


INERTIA = types.NamedTuple([FLOATS, FLOATS, *[types.int32[::1]] * 3], Inertia)
"""The type of an `Inertia` in compiled code."""


@plain
def whiten(nnz, adr, col, val, start, work, mark, inertia, root, trees, out, colout):
    """Append one row of ``Y = J L^-1 D^-1/2`` to the known rows of Y, and return the number of its entries.

    Entries of J that are rounding are set to 0: a row of such entries would admit huge impulses.

    Args:
        nnz: number of entries of the row of J.
        adr: index of the first entry.
        col: degree of freedom of all entries of J.
        val: the entries of J.
        start: index in ``out`` at which the row begins.
        work: zeros, (nv,); zeros again at the end.
        mark: trees that the row touches, (ntree,); False again at the end.
        inertia: the mass matrix.
        root: ``D^-1/2``, (nv,).
        trees: tree of each degree of freedom, and first degree of freedom and number of these for each tree.
        out: the entries of Y.
        colout: degree of freedom of each entry of Y.
    """
    tree, first, many = trees
    for k in range(adr, adr + nnz):
        if abs(val[k]) > _ROUNDING:
            work[col[k]] = val[k]
            mark[tree[col[k]]] = True
    count = start
    for k in range(adr, adr + nnz):
        t = tree[col[k]]
        if not mark[t]:
            continue
        mark[t] = False
        for i in range(first[t] + many[t] - 1, first[t] - 1, -1):
            x = work[i]
            if x != 0.0:
                for a in range(inertia.adr[i], inertia.adr[i] + inertia.nnz[i] - 1):
                    work[inertia.col[a]] -= inertia.factor[a] * x
                out[count] = x * root[i]
                colout[count] = i
                count += 1
                work[i] = 0.0
    return count - start


@plain
def unwhitened(z, inertia, root, v):
    """Write ``L^-1 D^-1/2 z``, the velocity for whitened coordinates z, (nv,)."""
    for i in range(len(z)):
        s = z[i] * root[i]
        for a in range(inertia.adr[i], inertia.adr[i] + inertia.nnz[i] - 1):
            s -= inertia.factor[a] * v[inertia.col[a]]
        v[i] = s


@plain
def apply_inverse(inertia, x):
    """Replace a force, (nv,), by ``M^-1 f``."""
    factor, inverse, nnz, adr, col = inertia
    for i in range(len(x) - 1, -1, -1):
        s = x[i]
        for a in range(adr[i], adr[i] + nnz[i] - 1):
            x[col[a]] -= factor[a] * s
    for i in range(len(x)):
        s = x[i] * inverse[i]
        for a in range(adr[i], adr[i] + nnz[i] - 1):
            s -= factor[a] * x[col[a]]
        x[i] = s


@plain
def whitened(velocity, inertia, root, z):
    """Write ``z = D^1/2 L v``, (nv,), whose products with whitened rows are the velocities of the rows."""
    for i in range(len(velocity)):
        s = velocity[i]
        for a in range(inertia.adr[i], inertia.adr[i] + inertia.nnz[i] - 1):
            s += inertia.factor[a] * velocity[inertia.col[a]]
        z[i] = s / root[i]
