"""Equality constraints in collisions, in compiled code: impulses that leave their velocities alone.

See `mechanics.bilateral`: with an orthonormal basis B of the whitened gradients of the constraints the gradients Y of
contacts become ``Y P, P = I - B^T B``.
"""

from __future__ import annotations

import numpy as np

from impactlaw.mechanics.tolerances import FIXED
from impactlaw.scene.tolerances import OWN_CONSTRAINT
from impactlaw.solvers.cones.algebra.loops import clear, dot, integers, numbers, once, plain
from impactlaw.solvers.tolerances import RANK
from impactlaw.stepping.compiled.access import data_floats, data_ints, layout_of, number, size
from impactlaw.stepping.compiled.fields import DATA, MODEL
from impactlaw.stepping.compiled.ties import leave_out
from impactlaw.stepping.soft.compiled.contacts.rows import Rows

_CLEAR = 2.0 * OWN_CONSTRAINT
"""Part of a gradient that no other constraint has, from which it is one of its own whatever has given way."""


@plain
def whitened_row(nnz, adr, col, val, row, factor, Mnnz, Madr, Mcol, root, out):
    """Write ``D^-1/2 L^-T J^T`` of one of MuJoCo's rows, (nv,)."""
    clear(out)
    for a in range(adr[row], adr[row] + nnz[row]):
        out[col[a]] = val[a]
    for i in range(len(out) - 1, -1, -1):
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            out[Mcol[a]] -= factor[a] * out[i]
        out[i] *= root[i]


@plain
def span(w, bilateral, calm, jacobian, root, basis):
    """Write an orthonormal basis of the constraints that collisions keep, row by row; return how many there are.

    It is -1 where rows depend on each other nearly: what counts then is decided in Python.

    Args:
        w: the world.
        bilateral: which constraints are kept, uint8 (neq,).
        calm: velocity of a constraint, m/s or rad/s, above which it is giving way, and is not kept.
        jacobian: MuJoCo's rows.
        root: ``D^-1/2``, (nv,).
        basis: room for as many rows as there are constraints and one more, (ne + 1) nv.
    """
    count, nv, many = 0, w.nv, number(w, DATA.ne)
    nnz, adr, col, val = jacobian
    Mnnz, Madr, Mcol = layout_of(w)
    factor, source = data_floats(w, DATA.qLD, size(w, MODEL.nC)), data_ints(w, DATA.efc_id, number(w, DATA.nefc))
    speeds = data_floats(w, DATA.efc_vel, number(w, DATA.nefc))
    for r in range(many):
        if bilateral[source[r]] == 0 or abs(speeds[r]) > calm:
            continue
        at = count * nv
        whitened_row(nnz, adr, col, val, r, factor, Mnnz, Madr, Mcol, root, basis[at : at + nv])
        left = leave_out(basis, count, nv, basis, at)
        if left >= _CLEAR:
            length = np.sqrt(dot(basis, at, basis, at, nv))
            for i in range(at, at + nv):
                basis[i] /= length
            count += 1
        elif left > RANK:
            return -1
    return count


@plain
def _project(rows, nv, basis, count, adr, nnz, col, val):
    """Write the rows that are left, all columns; return whether something is left of each."""
    clear(val)
    for r in range(len(nnz)):
        at = r * nv
        adr[r], nnz[r] = at, nv
        for i in range(nv):
            col[at + i] = i
        for a in range(rows.adr[r], rows.adr[r] + rows.nnz[r]):
            val[at + rows.col[a]] = rows.val[a]
        if not leave_out(basis, count, nv, val, at) > FIXED:
            return False
    return True


@once
def projected(rows, nv, basis, count):
    """Return `Rows` without their part along a basis, which live as long as the function that asks for them.

    And whether something is left of each.
    """
    n = len(rows.nnz)
    adr, nnz, col, val = integers(n), integers(n), integers(n * nv), numbers(n * nv)
    moves = _project(rows, nv, basis, count, adr, nnz, col, val)
    return Rows(rows.of, rows.first, rows.sizes, nnz, adr, col, val), moves
