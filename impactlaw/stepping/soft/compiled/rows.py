"""Contacts and limits of now in compiled code: MuJoCo's constraint rows, along normals and tangents, whitened."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.scene.tolerances import NO_FRICTION
from impactlaw.solvers.cones.algebra.loops import kernel, plain
from impactlaw.stepping.compiled.access import (
    contact_floats,
    contact_ints,
    data_floats,
    jacobian_of,
    layout_of,
    model_ints,
    number,
    option,
    size,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL
from impactlaw.stepping.compiled.whitening import whiten

Array = np.ndarray[Any, Any]

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)


class Found(NamedTuple):
    """The contacts and limits that MuJoCo's solver acts on.

    Attributes:
        row: MuJoCo's first row of each, int64 (h,).
        contact: its number among MuJoCo's contacts, -1 for a limit, int64 (h,).
        paired: whether it is a pyramid: pairs of rows, whose mean is the normal, int64 (h,).
    """

    row: Array
    contact: Array
    paired: Array


class Rows(NamedTuple):
    """Whitened rows of some contacts, contact by contact, the normal first, then friction times its coefficients.

    Attributes:
        of: which of `Found` each contact is, int64 (k,).
        first: its first row, int32 (k,).
        count: its rows, int32 (k,).
        nnz: entries of each row, int32 (n,).
        adr: where they begin, int32 (n,).
        col: their degrees of freedom, int32.
        val: the entries.
    """

    of: Array
    first: Array
    count: Array
    nnz: Array
    adr: Array
    col: Array
    val: Array


@kernel
def find(w):
    """Return the contacts and limits of now."""
    limits, first, many = number(w, DATA.nl), number(w, DATA.ne) + number(w, DATA.nf), number(w, DATA.ncon)
    address, dim = contact_ints(w, CONTACT.efc_address, 1)[:, 0], contact_ints(w, CONTACT.dim, 1)[:, 0]
    pyramidal = option(w, MODEL.opt_cone) == _PYRAMIDAL
    row, contact = np.empty(limits + many, np.int64), np.empty(limits + many, np.int64)
    paired, h = np.zeros(limits + many, np.int64), limits
    for i in range(limits):
        row[i], contact[i] = first + i, -1
    for i in range(many):
        if address[i] >= 0:
            row[h], contact[h], paired[h] = address[i], i, pyramidal and dim[i] > 1
            h += 1
    return Found(row[:h], contact[:h], paired[:h])


@plain
def normal_velocities(found, velocity, gamma):
    """Write the contact velocities, (h,), from velocities of MuJoCo's rows, (nefc,); return the lowest."""
    lowest = 0.0
    for i in range(len(gamma)):
        row = found.row[i]
        gamma[i] = 0.5 * (velocity[row] + velocity[row + 1]) if found.paired[i] else velocity[row]
        lowest = min(lowest, gamma[i])
    return lowest


@kernel
def within_reach(w, found, gamma, speed, rounding):
    """Return which contacts that do not separate, up to rounding, share a tree, in steps, with one that is faster than speed, bool."""
    nnz, adr, col, val = jacobian_of(w)
    tree, reached, more = model_ints(w, MODEL.dof_treeid, w.nv), np.zeros(len(gamma), np.bool_), True
    mark = np.zeros(size(w, MODEL.ntree), np.bool_)
    while more:
        more = False
        for i in range(len(gamma)):
            if reached[i] or gamma[i] > rounding:
                continue
            r, near = found.row[i], gamma[i] < -speed
            for a in range(adr[r], adr[r] + nnz[r]):
                near = near or (val[a] != 0.0 and mark[tree[col[a]]])
            if near:
                reached[i] = more = True
                for a in range(adr[r], adr[r] + nnz[r]):
                    if val[a] != 0.0:
                        mark[tree[col[a]]] = True
    return reached


@kernel
def _count(w, found, reached, jacobian, frictional):
    """Return numbers of contacts, rows and entries that have room for the rows of contacts."""
    dim, mu = contact_ints(w, CONTACT.dim, 1)[:, 0], contact_floats(w, CONTACT.friction, 5)
    nnz, adr, col, val = jacobian
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
def read(w, found, reached, frictional):
    """Return `Rows` of the contacts that are reached, bool (h,)."""
    jacobian = jacobian_of(w)
    nnz, adr, col, val = jacobian
    k, n, m = _count(w, found, reached, jacobian, frictional)
    of, first, count = np.empty(k, np.int64), np.empty(k, np.int32), np.empty(k, np.int32)
    rownnz, rowadr, outcol, out = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(m, np.int32), np.empty(m)
    dim, mu = contact_ints(w, CONTACT.dim, 1)[:, 0], contact_floats(w, CONTACT.friction, 5)
    trees = size(w, MODEL.ntree)
    tree, treeadr = model_ints(w, MODEL.dof_treeid, w.nv), model_ints(w, MODEL.tree_dofadr, trees)
    treenum = model_ints(w, MODEL.tree_dofnum, trees)
    Mnnz, Madr, Mcol = layout_of(w)
    factor, root = data_floats(w, DATA.qLD, size(w, MODEL.nC)), np.sqrt(data_floats(w, DATA.qLDiagInv, w.nv))
    work, mark, mixed = np.zeros(w.nv), np.zeros(trees, np.bool_), np.empty(w.nv)
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
                wide, 0, col[adr[row] : adr[row] + wide], mixed, end, work, mark, factor, Mnnz, Madr, Mcol, root,
                tree, treeadr, treenum, out, outcol,
            )  # fmt: skip
            end += rownnz[r]
            r += 1
        count[g] = r - first[g]
        g += 1
    return Rows(of, first, count, rownnz[:r], rowadr[:r], outcol[:end], out[:end])


@plain
def _couples(rows, work, length, g, other):
    """Return whether rows of another contact, scattered to work one by one, meet those of a contact."""
    for i in range(rows.first[other], rows.first[other] + rows.count[other]):
        for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
            work[rows.col[a]] = rows.val[a]
        meets = False
        for k in range(rows.first[g], rows.first[g] + rows.count[g]):
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
    work, length = np.zeros(nv), np.empty(len(rows.nnz))
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
