"""Equality constraints that keep their velocity in collisions, in compiled code.

See `mechanics.bilateral`: with an orthonormal basis B of the whitened gradients of the constraints, the gradients Y of
contacts become ``Y P`` with ``P = I - B^T B``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from impactlaw.mechanics.tolerances import FIXED
from impactlaw.solvers.cones.algebra.loops import clear, integers, kernel, numbers, once, plain
from impactlaw.stepping.compiled.access import data_floats, data_ints, inertia_of, model_ints, number
from impactlaw.stepping.compiled.fields import DATA, MODEL
from impactlaw.stepping.compiled.islands import tree_of
from impactlaw.stepping.compiled.left_out.constraint_basis import least_length, orthonormal
from impactlaw.stepping.compiled.left_out.tied_contacts import leave_out, parts_of_longest, write_lengths
from impactlaw.stepping.soft.compiled.contacts.rows import Rows

Array = np.ndarray[Any, Any]


class Gradients(NamedTuple):
    """What the collisions of one instant have in common."""

    jacobian: tuple[Array, Array, Array, Array]  # muJoCo's rows, see `access.jacobian_of`
    root: Array  # ``D^-1/2``, (nv,)
    basis: Array  # see `span`, (m nv,) for m directions


@plain
def whitened_row(jacobian, row, inertia, root, out):
    """Write ``D^-1/2 L^-T J^T`` of one of MuJoCo's rows, (nv,)."""
    nnz, adr, col, val = jacobian
    clear(out)
    for a in range(adr[row], adr[row] + nnz[row]):
        out[col[a]] = val[a]
    for i in range(len(out) - 1, -1, -1):
        for a in range(inertia.adr[i], inertia.adr[i] + inertia.nnz[i] - 1):
            out[inertia.col[a]] -= inertia.factor[a] * out[i]
        out[i] *= root[i]


@plain
def is_kept(w, bilateral, calm, jacobian, r):
    """Return whether a constraint row keeps its velocity, see `span`."""
    n, (nnz, adr, col, val) = number(w, DATA.nefc), jacobian
    source, speeds = data_ints(w, DATA.efc_id, n), data_floats(w, DATA.efc_vel, n)
    if bilateral[source[r]] == 0:
        return False
    t = tree_of(nnz, adr, col, val, r, model_ints(w, MODEL.dof_treeid, w.nv))
    return not abs(speeds[r]) > (calm[t] if t >= 0 else 0.0)


@kernel
def _rank(w, bilateral, calm, jacobian, part):
    """Write the relative lengths of rows in their constraint, (ne,); return the length up to which rows are negligible.

    Rows that do not keep their velocity get 0.
    """
    n, given, weight = number(w, DATA.nefc), 0.0, numbers(w.nv)
    source, gaps = data_ints(w, DATA.efc_id, n), data_floats(w, DATA.efc_pos, n)
    write_lengths(w, weight)
    parts_of_longest(source, bilateral, jacobian, weight, part)
    for r in range(len(part)):
        if is_kept(w, bilateral, calm, jacobian, r):
            given = max(given, abs(gaps[r]))
        else:
            part[r] = 0.0
    return least_length(w, given)


@kernel
def span(w, bilateral, calm, jacobian, root, basis):
    """Write an orthonormal basis of the constraints that keep their velocity, row by row; return its size.

    Nearly dependent rows are treated as in `equality_constraints.bilateral_rows`.

    Args:
        w: the world.
        bilateral: see `world.Law`.
        calm: for each tree of bodies, the speed of a constraint row, m/s or rad/s, above which it is giving way and
            does not keep its velocity, (ntree,).
        jacobian: MuJoCo's rows.
        root: ``D^-1/2``, (nv,).
        basis: written, with space for one row more than there are constraint rows, ((ne + 1) nv,).
    """
    many, nv, count = number(w, DATA.ne), w.nv, 0
    inertia, part, rows = inertia_of(w), numbers(many), numbers(many * nv)
    rank = _rank(w, bilateral, calm, jacobian, part)
    for r in range(many):
        if part[r] > rank:
            whitened_row(jacobian, r, inertia, root, rows[count * nv : count * nv + nv])
            count += 1
    return orthonormal(rows, count, nv, rank, basis)


@plain
def _project(rows, nv, basis, count, gamma, approach, adr, nnz, col, val):
    """Write dense rows without their part along the basis; return whether the result is a problem that can be solved.

    Rows of which no part is left become 0. Limits that constraints keep from moving then influence no other contact.
    There must be a part of the normal of contacts with friction, and of those that collide.
    """
    clear(val)
    for g in range(len(rows.first)):
        for r in range(rows.first[g], rows.first[g] + rows.sizes[g]):
            at = r * nv
            adr[r], nnz[r] = at, nv
            for i in range(nv):
                col[at + i] = i
            for a in range(rows.adr[r], rows.adr[r] + rows.nnz[r]):
                val[at + rows.col[a]] = rows.val[a]
            if leave_out(basis, count, nv, val, at) > FIXED:
                continue
            i = rows.of[g]
            if r == rows.first[g] and (rows.sizes[g] > 1 or gamma[i] < -approach[i]):
                return False
            clear(val[at : at + nv])
    return True


@once
def projected(rows, nv, basis, count, gamma, approach):
    """Return `Rows` without their part along a basis, and whether the result is a problem that can be solved.

    The rows are valid until the function that calls this returns. Contact velocities `gamma`, and closing speeds above
    which contacts collide, are those of all contacts, (h,).
    """
    n = len(rows.nnz)
    adr, nnz, col, val = integers(n), integers(n), integers(n * nv), numbers(n * nv)
    moves = _project(rows, nv, basis, count, gamma, approach, adr, nnz, col, val)
    return Rows(rows.of, rows.first, rows.sizes, nnz, adr, col, val), moves
