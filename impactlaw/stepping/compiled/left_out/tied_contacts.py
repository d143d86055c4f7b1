"""Find contacts that equality constraints leave almost no motion: those between two bodies tied to each other.

If bodies are welded, or joined in a point next to which they touch, the gradient of their gap depends linearly on those
of the constraint. Neither could be satisfied without violating the other: its demand is divided by the small remainder
that the other leaves, and bodies burst apart. Such contacts are left out, like those of bodies connected by a joint.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.equality_constraints import SHIFTS, STOPPED, TIED, TYING
from impactlaw.scene.tolerances import OWN_CONSTRAINT, WRITTEN
from impactlaw.solvers.cones.algebra.loops import FIRST, clear, cleared, dot, kernel, norm, numbers, plain, subtract
from impactlaw.stepping.compiled.access import bodies_of, contact_ints, model_floats, model_ints, option, row_ints, size
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
_MOST = 2e7  # operations for the constraints of a step (hundreds of them) above which no contact counts as tied


@plain
def _write_scaled(jacobian, row, weight, out):
    """Write one of MuJoCo's rows, (nv,), divided by the lengths of degrees of freedom."""
    nnz, adr, col, J = jacobian
    clear(out)
    for a in range(adr[row], adr[row] + nnz[row]):
        out[col[a]] = J[a] / weight[col[a]]


@plain
def leave_out(basis, count, nv, row, at):
    """Subtract from nv numbers of a row their part along the basis; return the remaining part of its length."""
    before = np.sqrt(dot(row, at, row, at, nv))
    for _ in range(2):  # the second pass removes rounding
        for b in range(count):
            subtract(row, at, basis, b * nv, dot(row, at, basis, b * nv, nv), nv)
    return np.sqrt(dot(row, at, row, at, nv)) / before if before > 0.0 else 0.0


@plain
def _largest(numbers_of):
    largest = 0.0
    for one in numbers_of:
        largest = max(largest, abs(one))
    return largest


@kernel
def parts_of_longest(number, constraints, jacobian, weight, part):
    """Write relative lengths of rows of equality constraints, (ne,), see `equality_constraints.parts_of_longest`.

    For the other arguments see `find_tied`.
    """
    trial, first = numbers(len(weight)), 0
    while first < len(part):
        end = first
        while end < len(part) and number[end] == number[first]:
            _write_scaled(jacobian, end, weight, trial)
            part[end] = norm(trial)
            end += 1
        middle = min(first + SHIFTS, end)
        shifts, turns = _largest(part[first:middle]), _largest(part[middle:end])
        whole = WRITTEN * max(shifts, turns)
        for row in range(first, end):
            if constraints[number[first]] != TYING:
                part[row] = 1.0 if part[row] > 0.0 else 0.0
            elif part[row] > 0.0:
                part[row] /= max(shifts if row < middle else turns, whole)
        first = end


@plain
def _span(number, constraints, jacobian, weight, part, basis):
    """Write an orthonormal basis of the constraints that tie bodies, row by row; return its size."""
    nv, count = len(weight), 0
    for row in range(len(part)):
        if constraints[number[row]] != TYING or part[row] <= OWN_CONSTRAINT:
            continue
        at = count * nv
        _write_scaled(jacobian, row, weight, basis[at : at + nv])
        if leave_out(basis, count, nv, basis, at) > OWN_CONSTRAINT:
            length = np.sqrt(dot(basis, at, basis, at, nv))
            for i in range(at, at + nv):
                basis[i] /= length
            count += 1
    return count


@plain
def _write_normal(jacobian, row, paired, weight, out):
    """Write the gradient of a gap, (nv,), as `_write_scaled` does; where it is `paired`, it is the mean of two rows."""
    nnz, adr, col, J = jacobian
    _write_scaled(jacobian, row, weight, out)
    if paired:
        for a in range(adr[row + 1], adr[row + 1] + nnz[row + 1]):
            out[col[a]] += J[a] / weight[col[a]]
        for i in range(len(out)):
            out[i] *= 0.5


@kernel
def find_tied(kinds, number, constraints, jacobian, weight, address, paired, least, tied):
    """Write which contacts are tied, bool (ncon,), initially False.

    Args:
        kinds: kinds of MuJoCo's rows, (nefc,).
        number: constraint that each row belongs to, (nefc,).
        constraints: kinds of equality constraints, see `equality_constraints.constraint_kinds`, uint8 (neq,).
        jacobian: number of entries and first entry of each row, degree of freedom of each entry, and the entries.
        weight: see `equality_constraints.lengths`, (nv,).
        address: first rows of contacts, (ncon,).
        paired: whether they are pyramids: pairs of rows, whose mean is the normal, bool (ncon,).
        least: see `equality_constraints.least_free`, (ncon,).
        tied: written.
    """
    nv, many, ne = len(weight), 0, 0
    for row in range(len(kinds)):
        ne += kinds[row] == 0
        many += kinds[row] == 0 and constraints[number[row]] == TYING
    if many == 0 or float(many) * many * nv > _MOST:
        return
    basis, trial, part = numbers((many + 1) * nv), numbers(nv), numbers(ne)
    parts_of_longest(number, constraints, jacobian, weight, part)
    count = _span(number, constraints, jacobian, weight, part, basis)
    for c in range(len(address)):
        if address[c] >= 0:
            _write_normal(jacobian, address[c], paired[c], weight, trial)
            whole = _largest(trial)
            leave_out(basis, count, nv, trial, FIRST)
            tied[c] = dot(trial, FIRST, trial, FIRST, nv) <= least[c] * whole * _largest(trial)


@plain
def write_lengths(w, weight):
    """Write `equality_constraints.lengths`, (nv,)."""
    body, inertia = model_ints(w, MODEL.dof_bodyid, w.nv), model_floats(w, MODEL.dof_M0, w.nv)
    mass = model_floats(w, MODEL.body_subtreemass, size(w, MODEL.nbody))
    for i in range(w.nv):
        weight[i] = np.sqrt(inertia[i] / max(mass[body[i]], 1e-15))


@plain
def _write_least(w, least):
    """Write `equality_constraints.least_free`, (ncon,)."""
    geom, (body, _, tree) = contact_ints(w, CONTACT.geom, 2), bodies_of(w)
    for c in range(len(least)):
        least[c] = TIED
        for side in range(2):
            if geom[c, side] >= 0 and tree[body[geom[c, side]]] < 0:
                least[c] = STOPPED


@kernel
def mark_tied(w, constraints, jacobian, tied):
    """Write which contacts of a world are tied, see `find_tied`."""
    weight, least = numbers(w.nv), numbers(len(tied))
    write_lengths(w, weight)
    _write_least(w, least)
    address, dim = contact_ints(w, CONTACT.efc_address, 1)[:, 0], contact_ints(w, CONTACT.dim, 1)[:, 0]
    pyramidal, paired = option(w, MODEL.opt_cone) == _PYRAMIDAL, cleared(len(tied))
    for c in range(len(tied)):
        paired[c] = pyramidal and dim[c] > 1
    kinds, of_rows = row_ints(w, DATA.efc_type), row_ints(w, DATA.efc_id)
    find_tied(kinds, of_rows, constraints, jacobian, weight, address, paired, least, tied)
