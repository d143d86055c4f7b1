"""The rows of one step: MuJoCo's constraint rows, whitened and grouped into contacts, limits, equalities, dry friction.

The mass matrix of a step is the one of its integrator, ``M_h = M + h B`` where damping B is implicit, which MuJoCo
keeps as ``M_h = L^T D L``. A row of ``Y = J L^-1 D^-1/2`` is the gradient where the kinetic metric of the step is the
Euclidean one: ``Y Y^T = J M_h^-1 J^T``, the Delassus matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

BILATERAL, BOX, CONE = 0, 1, 2
"""Kinds of groups of rows, see `impactlaw.solvers.cones.solve`."""

_EQUALITY, _LOSS, _LIMIT, _ELLIPTIC = 0, (1, 2), (3, 4), 7  # mjtConstraint
_NO_FRICTION = 1.0000001e-5
"""Coefficient up to which a row of friction is left out: MuJoCo's own smallest one, which stands for none."""


class Rows(NamedTuple):
    """The rows of a step, group by group; a group is a contact, a limit, a row of an equality or of dry friction.

    Attributes:
        rownnz: entries of each row of Y, int32 (n,).
        rowadr: where they begin, int32 (n,).
        colind: their degrees of freedom, int32.
        value: the entries.
        first: first row of each group, int32 (g,).
        size: rows of each group, int32 (g,).
        kind: `BILATERAL`, `BOX` or `CONE`, int32 (g,).
        bound: largest impulse of a group of dry friction, N s, (g,).
        source: number of the contact among MuJoCo's, of a limit ``-1 - row``, else -1, int32 (g,).
        key: what tells a group from others from step to step, int64 (g,).
        gap: of contacts and limits, m or rad, (g,).
        row: MuJoCo's row of each row, int32 (n,).
        scale: coefficient of friction of rows of friction, else 1, (n,).
        before: ``J v``, velocity of each row at the start of the step, m/s or rad/s, (n,).
        free: ``J v_free``, that to which the forces without contact lead, (n,).
        rest: velocity at which an equality is met, (n,).
        compliance: R of MuJoCo's soft equalities, else 0, (n,).
    """

    rownnz: np.ndarray
    rowadr: np.ndarray
    colind: np.ndarray
    value: np.ndarray
    first: np.ndarray
    size: np.ndarray
    kind: np.ndarray
    bound: np.ndarray
    source: np.ndarray
    key: np.ndarray
    gap: np.ndarray
    row: np.ndarray
    scale: np.ndarray
    before: np.ndarray
    free: np.ndarray
    rest: np.ndarray
    compliance: np.ndarray


@njit(cache=True, error_model="numpy")
def _group(kinds, address, dim, friction, number, row, frictional):
    """Return the kind of the group that begins at a row, and its rows, those without friction left out."""
    kind = kinds[row]
    if kind == 0:
        return BILATERAL, 1, 1
    if kind <= 2:
        return BOX, 1, 1
    if kind != _ELLIPTIC:
        return CONE, 1, 1
    contact = number[row]
    rows = 1
    if frictional:
        for k in range(dim[contact] - 1):
            rows += friction[contact, k] > _NO_FRICTION
    return CONE, rows, dim[contact]


@njit(cache=True, error_model="numpy")
def whiten(nnz, adr, col, val, start, work, mark, factor, Mnnz, Madr, Mcol, root, tree, treeadr, treenum, out, colout):
    """Write one row of ``Y = J L^-1 D^-1/2`` to the end of what is known of Y and return the number of its entries.

    Args:
        nnz: entries of the row of J.
        adr: where they begin.
        col: degrees of freedom of all entries of J.
        val: the entries of J.
        start: where the row is to begin in out.
        work: zeros, (nv,); zeros again in the end.
        mark: trees that the row touches, (ntree,); False again in the end.
        factor: L, strictly lower part of rows as in MuJoCo's M.
        Mnnz: entries of each row of M.
        Madr: where they begin.
        Mcol: their columns, the diagonal last.
        root: ``D^-1/2``, (nv,).
        tree: of each degree of freedom.
        treeadr: first degree of freedom of each tree.
        treenum: number of them.
        out: the entries of Y.
        colout: their degrees of freedom.
    """
    for k in range(adr, adr + nnz):
        if val[k] != 0.0:
            work[col[k]] = val[k]
            mark[tree[col[k]]] = True
    count = start
    for k in range(adr, adr + nnz):
        t = tree[col[k]]
        if not mark[t]:
            continue
        mark[t] = False
        for i in range(treeadr[t] + treenum[t] - 1, treeadr[t] - 1, -1):
            x = work[i]
            if x != 0.0:
                for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
                    work[Mcol[a]] -= factor[a] * x
                out[count] = x * root[i]
                colout[count] = i
                count += 1
                work[i] = 0.0
    return count - start


@njit(cache=True, error_model="numpy")
def unwhiten(z, factor, Mnnz, Madr, Mcol, root):
    """Return ``L^-1 D^-1/2 z``, the velocity of whitened coordinates, (nv,)."""
    v = np.empty_like(z)
    for i in range(len(z)):
        s = z[i] * root[i]
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            s -= factor[a] * v[Mcol[a]]
        v[i] = s
    return v


@njit(cache=True, error_model="numpy")
def read_rows(
    kinds, number, position, velocity, reference, regularizer, loss,
    Jnnz, Jadr, Jcol, J,
    address, dim, geoms, friction,
    Mnnz, Madr, Mcol, factor, inverse, tree, treeadr, treenum,
    before, free, timestep, frictional,
):  # fmt: skip
    """Return what `Rows` holds, as a tuple in its order; the arguments are MuJoCo's arrays of now.

    Dense rows are given as sparse ones with all entries.
    """
    n, nv, ntree = len(kinds), len(before), len(treeadr)
    groups, rows, entries = 0, 0, 0
    row = 0
    while row < n:
        kind, size, step = _group(kinds, address, dim, friction, number, row, frictional)
        groups += 1
        rows += size
        row += step
    mark = np.zeros(ntree, np.bool_)
    for row in range(n):
        for k in range(Jadr[row], Jadr[row] + Jnnz[row]):
            t = tree[Jcol[k]]
            if J[k] != 0.0 and not mark[t]:
                mark[t] = True
                entries += treenum[t]
        for k in range(Jadr[row], Jadr[row] + Jnnz[row]):
            mark[tree[Jcol[k]]] = False
    first, size_of, kind_of = np.empty(groups, np.int32), np.empty(groups, np.int32), np.empty(groups, np.int32)
    source, key, gap, bound = (
        np.full(groups, -1, np.int32), np.empty(groups, np.int64), np.zeros(groups), np.zeros(groups)
    )  # fmt: skip
    rownnz, rowadr, place = np.empty(rows, np.int32), np.empty(rows, np.int32), np.empty(rows, np.int32)
    scale, was, is_free = np.ones(rows), np.zeros(rows), np.zeros(rows)
    rest, compliance = np.zeros(rows), np.zeros(rows)
    colind, value = np.empty(entries, np.int32), np.empty(entries)
    root, work = np.sqrt(inverse), np.zeros(nv)
    row, g, r, end = 0, 0, 0, 0
    while row < n:
        kind, size, step = _group(kinds, address, dim, friction, number, row, frictional)
        first[g], size_of[g], kind_of[g] = r, size, kind
        key[g] = -1 - (np.int64(number[row]) * 8 + kinds[row])
        if kind == BOX:
            bound[g] = timestep * loss[row]
        elif kind == CONE:
            gap[g] = position[row]
            if kinds[row] >= 5:
                source[g] = number[row]
                one, other = geoms[number[row], 0], geoms[number[row], 1]
                key[g] = (np.int64(min(one, other)) << 32) + max(one, other)
            else:
                source[g] = -1 - row
        for k in range(step):
            if k > 0:
                if not frictional:
                    break
                mu = friction[number[row], k - 1]
                if not mu > _NO_FRICTION:
                    continue
                scale[r] = mu
            i = row + k
            place[r] = i
            if kind == BILATERAL:
                rest[r] = velocity[i] + timestep * reference[i]
                compliance[r] = regularizer[i]
            rowadr[r] = end
            for a in range(Jadr[i], Jadr[i] + Jnnz[i]):
                was[r] += J[a] * before[Jcol[a]]
                is_free[r] += J[a] * free[Jcol[a]]
            rownnz[r] = whiten(
                Jnnz[i], Jadr[i], Jcol, J, end, work, mark, factor, Mnnz, Madr, Mcol, root, tree, treeadr, treenum,
                value, colind,
            )  # fmt: skip
            for a in range(end, end + rownnz[r]):
                value[a] *= scale[r]
            end += rownnz[r]
            if kind == CONE:  # MuJoCo's has the velocity of belts in it
                is_free[r] += velocity[i] - was[r]
                was[r] = velocity[i]
            r += 1
        row += step
        g += 1
    return (
        rownnz, rowadr, colind[:end], value[:end], first, size_of, kind_of, bound, source, key, gap, place, scale, was,
        is_free, rest, compliance,
    )  # fmt: skip
