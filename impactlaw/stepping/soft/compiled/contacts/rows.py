"""Rows of contacts along normals and tangents, whitened, and which contacts influence each other, in compiled code."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.scene.corrected.rounding import is_orthogonal
from impactlaw.scene.tolerances import NO_FRICTION
from impactlaw.solvers.cones.algebra.loops import FIRST, cleared, indices, integers, kernel, numbers, once, plain, zeros
from impactlaw.stepping.compiled.access import (
    contact_floats,
    contact_ints,
    inertia_of,
    layout_of_trees,
    model_ints,
    size,
)
from impactlaw.stepping.compiled.fields import CONTACT, MODEL
from impactlaw.stepping.compiled.whitening import whiten
from impactlaw.stepping.soft.compiled.contacts.tangents import TORSION, find_turning, lengthen, shift_to_body, write_row

Array = np.ndarray[Any, Any]


class Rows(NamedTuple):
    """Whitened rows of k contacts: for each contact the normal, then friction rows times their coefficients."""

    of: Array  # index of each contact in `ActiveContacts`, int64 (k,)
    first: Array  # first row of each contact, int32 (k,)
    sizes: Array  # number of rows of each contact, int32 (k,)
    nnz: Array  # number of entries of each row, int32 (n,)
    adr: Array  # index of the first entry of each row, int32 (n,)
    col: Array  # degree of freedom of each entry, int32
    val: Array  # the entries


@plain
def _count(w, found, reached, jacobian, frictional, mark):
    """Return the number of contacts, of their rows, and the largest number of entries; `mark` is False, (ntree,)."""
    dim, mu = contact_ints(w, CONTACT.dim, 1)[:, 0], contact_floats(w, CONTACT.friction, 5)
    nnz, adr, col, _ = jacobian
    tree, num = model_ints(w, MODEL.dof_treeid, w.nv), model_ints(w, MODEL.tree_dofnum, len(mark))
    contacts, rows, entries = 0, 0, 0
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


@plain
def _mix(found, i, d, scale, nnz, adr, val, mixed):
    """Write a row of a contact from MuJoCo's: along the normal, or a tangent times its coefficient of friction."""
    row = found.row[i]
    if found.paired[i]:
        one, other = adr[row + 2 * max(d - 1, 0)], adr[row + 2 * max(d - 1, 0) + 1]
        sign = 0.5 if d == 0 else -0.5
        for a in range(nnz[row]):
            mixed[a] = 0.5 * val[one + a] + sign * val[other + a]
    else:
        for a in range(nnz[row]):
            mixed[a] = scale * val[adr[row + d] + a]


@plain
def _fill(w, found, jacobian, reached, root, frictional, mark, work, mixed, turn, rows):
    """Write the rows of the `reached` contacts, and return the number of entries."""
    nnz, adr, col, val = jacobian
    dim, mu = contact_ints(w, CONTACT.dim, 1)[:, 0], contact_floats(w, CONTACT.friction, 5)
    frame, trees, inertia, g, r, end = contact_floats(w, CONTACT.frame, 9), layout_of_trees(w), inertia_of(w), 0, 0, 0
    for i in range(len(reached)):
        if not reached[i]:
            continue
        rows.of[g], rows.first[g] = i, r
        c, row = found.contact[i], found.row[i]
        shift = shift_to_body(w, c) if frictional and c >= 0 and dim[c] > 1 else 0.0
        lever, own = shift * find_turning(w, c, turn) if shift != 0.0 else 0.0, col[adr[row] : adr[row] + nnz[row]]
        for d in range(dim[c] if frictional and c >= 0 else 1):
            if d > 0 and not mu[c, d - 1] > NO_FRICTION:
                continue
            if d == 0 or is_orthogonal(frame, c):
                _mix(found, i, d, 1.0 if d == 0 else mu[c, d - 1], nnz, adr, val, mixed)
                if lever != 0.0 and 0 < d < TORSION:
                    lengthen(w, c, d, lever * mu[c, d - 1], turn, own, mixed)
            else:
                write_row(w, c, d, shift, mu[c, d - 1], own, mixed)
            rows.adr[r] = end
            rows.nnz[r] = whiten(
                nnz[row], FIRST, own, mixed, end, work, mark, inertia, root, trees, rows.val, rows.col
            )  # fmt: skip
            end += rows.nnz[r]
            r += 1
        rows.sizes[g] = r - rows.first[g]
        g += 1
    return end


@once
def read(w, found, jacobian, reached, root, frictional):
    """Return `Rows` of the `reached` contacts, bool (h,), which are valid until the function that calls this returns.

    ``root`` is ``D^-1/2``, (nv,).
    """
    mark = cleared(size(w, MODEL.ntree))
    k, n, m = _count(w, found, reached, jacobian, frictional, mark)
    rows = Rows(indices(k), integers(k), integers(k), integers(n), integers(n), integers(m), numbers(m))
    work, mixed, turn = zeros(w.nv), numbers(w.nv), numbers(3 * w.nv)
    end = _fill(w, found, jacobian, reached, root, frictional, mark, work, mixed, turn, rows)
    return Rows(rows.of, rows.first, rows.sizes, rows.nnz, rows.adr, rows.col[:end], rows.val[:end])


@plain
def _couples(rows, work, length, g, other):
    """Return whether the impulse of contact `other` changes the velocity of contact g; work is zeros, (nv,)."""
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


@plain
def _reach(rows, gamma, approach, reached, work, length, queue):
    """Write the contacts that `reached_by` returns into `queue`, and return their number.

    Args:
        rows: the rows of contacts.
        gamma: velocities of all contacts, (h,).
        approach: closing speeds above which contacts collide, m/s or rad/s, (h,).
        reached: False before, (k,), written.
        work: zeros, (nv,).
        length: scratch space, (n,).
        queue: the contacts, (k,), written.
    """
    k, end, at = len(reached), 0, 0
    for g in range(k):
        if gamma[rows.of[g]] < -approach[rows.of[g]]:
            reached[g], queue[end], end = True, g, end + 1
    if end == k:
        return k
    for i in range(len(length)):
        s = 0.0
        for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
            s += rows.val[a] * rows.val[a]
        length[i] = np.sqrt(s)
    while at < end and end < k:
        other = queue[at]
        at += 1
        for g in range(k):
            if not reached[g] and _couples(rows, work, length, g, other):
                reached[g], queue[end], end = True, g, end + 1
    end = 0
    for g in range(k):
        if reached[g]:
            queue[end], end = g, end + 1
    return end


@once
def reached_by(rows, gamma, approach, nv):
    """Return the contacts that the impulses of contacts that collide reach, through others too, int64.

    The array is valid until the function that calls this returns.
    """
    queue = indices(len(rows.of))
    end = _reach(rows, gamma, approach, cleared(len(queue)), zeros(nv), numbers(len(rows.nnz)), queue)
    return queue[:end]


@kernel
def influenced(rows, g, nv, queue):
    """Write the contacts that the impulse of contact g reaches, through others too, and g; return their number.

    ``queue`` is written, (k,).
    """
    k = len(rows.of)
    gamma, approach = zeros(rows.of[k - 1] + 1), zeros(rows.of[k - 1] + 1)  # as if that contact alone collided
    gamma[rows.of[g]] = -1.0
    return _reach(rows, gamma, approach, cleared(k), zeros(nv), numbers(len(rows.nnz)), queue)


@once
def everyone(rows):
    """Return all contacts, int64, as an array that is valid until the function that calls this returns."""
    queue = indices(len(rows.of))
    for g in range(len(queue)):
        queue[g] = g
    return queue
