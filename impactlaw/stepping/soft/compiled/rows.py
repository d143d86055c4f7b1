"""Rows of contacts along normals and tangents in compiled code: MuJoCo's, whitened, and which meet which."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.scene.tolerances import NO_FRICTION
from impactlaw.solvers.cones.algebra.loops import FIRST, kernel, numbers, plain, zeros
from impactlaw.stepping.compiled.access import (
    contact_floats,
    contact_ints,
    data_floats,
    layout_of,
    model_ints,
    size,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL
from impactlaw.stepping.compiled.whitening import whiten

Array = np.ndarray[Any, Any]


class Rows(NamedTuple):
    """Whitened rows of some contacts, contact by contact, the normal first, then friction times its coefficients.

    Attributes:
        of: which of `Found` each contact is, int64 (k,).
        first: its first row, int32 (k,).
        sizes: its rows, int32 (k,).
        nnz: entries of each row, int32 (n,).
        adr: where they begin, int32 (n,).
        col: their degrees of freedom, int32.
        val: the entries.
    """

    of: Array
    first: Array
    sizes: Array
    nnz: Array
    adr: Array
    col: Array
    val: Array


@kernel
def _count(w, found, reached, jacobian, frictional):
    """Return numbers of contacts, rows and entries that have room for the rows of contacts."""
    dim, mu = contact_ints(w, CONTACT.dim, 1)[:, 0], contact_floats(w, CONTACT.friction, 5)
    nnz, adr, col, _ = jacobian
    tree, num = model_ints(w, MODEL.dof_treeid, w.nv), model_ints(w, MODEL.tree_dofnum, size(w, MODEL.ntree))
    contacts, rows, entries = 0, 0, 0
    mark = np.zeros(len(num), np.bool_)
    for i in range(len(reached)):
        if not reached[i]:
            continue
        own, c, r = 1, found.contact[i], found.row[i]
        if frictional and c >= 0:
            for k in range(dim[c] - 1):
                own += mu[c, k] > NO_FRICTION
        wide = 0
        for a in range(adr[r], adr[r] + nnz[r]):
            t = tree[col[a]]
            if not mark[t]:
                mark[t], wide = True, wide + num[t]
        for a in range(adr[r], adr[r] + nnz[r]):
            mark[tree[col[a]]] = False
        contacts, rows, entries = contacts + 1, rows + own, entries + own * wide
    return contacts, rows, entries


@kernel
def read(w, found, jacobian, reached, root, frictional):
    """Return `Rows` of the contacts that are reached, bool (h,); root is ``D^-1/2``, (nv,)."""
    nnz, adr, col, val = jacobian
    k, n, m = _count(w, found, reached, jacobian, frictional)
    of, places, out = np.empty(k, np.int64), np.empty(2 * k + 2 * n + m, np.int32), np.empty(m)
    first, count, rownnz = places[:k], places[k : 2 * k], places[2 * k : 2 * k + n]
    rowadr, outcol = places[2 * k + n : 2 * k + 2 * n], places[2 * k + 2 * n :]
    dim, mu = contact_ints(w, CONTACT.dim, 1)[:, 0], contact_floats(w, CONTACT.friction, 5)
    trees = size(w, MODEL.ntree)
    tree, treeadr = model_ints(w, MODEL.dof_treeid, w.nv), model_ints(w, MODEL.tree_dofadr, trees)
    treenum = model_ints(w, MODEL.tree_dofnum, trees)
    Mnnz, Madr, Mcol = layout_of(w)
    factor, work, mark = data_floats(w, DATA.qLD, size(w, MODEL.nC)), zeros(w.nv), np.zeros(trees, np.bool_)
    mixed = numbers(w.nv)
    g, r, end = 0, 0, 0
    for i in range(len(reached)):
        if not reached[i]:
            continue
        of[g], first[g] = i, r
        c, row = found.contact[i], found.row[i]
        many = dim[c] if frictional and c >= 0 else 1
        wide = nnz[row]
        for d in range(many):
            if d > 0 and not mu[c, d - 1] > NO_FRICTION:
                continue
            if found.paired[i]:
                one, other = adr[row + 2 * max(d - 1, 0)], adr[row + 2 * max(d - 1, 0) + 1]
                sign = 0.5 if d == 0 else -0.5
                for a in range(wide):
                    mixed[a] = 0.5 * val[one + a] + sign * val[other + a]
            else:
                scale = 1.0 if d == 0 else mu[c, d - 1]
                for a in range(wide):
                    mixed[a] = scale * val[adr[row + d] + a]
            rowadr[r] = end
            rownnz[r] = whiten(
                wide, FIRST, col[adr[row] : adr[row] + wide], mixed, end, work, mark, factor, Mnnz, Madr, Mcol,
                root, tree, treeadr, treenum, out, outcol,
            )  # fmt: skip
            end += rownnz[r]
            r += 1
        count[g] = r - first[g]
        g += 1
    return Rows(of, first, count, rownnz[:r], rowadr[:r], outcol[:end], out[:end])


@plain
def _couples(rows, work, length, g, other):
    """Return whether rows of another contact, scattered to work one by one, meet those of a contact."""
    for i in range(rows.first[other], rows.first[other] + rows.sizes[other]):
        for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
            work[rows.col[a]] = rows.val[a]
        meets = False
        for k in range(rows.first[g], rows.first[g] + rows.sizes[g]):
            s = 0.0
            for a in range(rows.adr[k], rows.adr[k] + rows.nnz[k]):
                s += rows.val[a] * work[rows.col[a]]
            meets = meets or abs(s) > INFLUENCE * length[i] * length[k]
        for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
            work[rows.col[a]] = 0.0
        if meets:
            return True
    return False


@kernel
def reached_by(rows, gamma, speed, nv):
    """Return the contacts that an impulse of one that is faster than speed can reach through others, int64."""
    k = len(rows.of)
    reached, queue, end = np.zeros(k, np.bool_), np.empty(k, np.int64), 0
    for g in range(k):
        if gamma[rows.of[g]] < -speed:
            reached[g], queue[end], end = True, g, end + 1
    if end == k:
        return queue
    work, length = zeros(nv), numbers(len(rows.nnz))
    for i in range(len(length)):
        s = 0.0
        for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
            s += rows.val[a] * rows.val[a]
        length[i] = np.sqrt(s)
    at = 0
    while at < end and end < k:
        other = queue[at]
        at += 1
        for g in range(k):
            if not reached[g] and _couples(rows, work, length, g, other):
                reached[g], queue[end], end = True, g, end + 1
    return np.sort(queue[:end])
