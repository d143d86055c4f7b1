"""Which of MuJoCo's rows take part in the contact problem of a step."""

from __future__ import annotations

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import cleared, plain
from impactlaw.stepping.compiled.access import contact_ints, number, row_floats, row_ints, size, velocity_of
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, flags
from impactlaw.stepping.compiled.left_out.tied_contacts import mark_tied
from impactlaw.stepping.time_stepping.compiled.detection.fast_bodies import leave_fast, some_can_pass, take_back
from impactlaw.stepping.time_stepping.compiled.detection.floor_edges import leave_edges
from impactlaw.stepping.time_stepping.compiled.detection.passed_edges import pass_over
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, MARKS, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.surfaces import surfaces_move
from impactlaw.stepping.time_stepping.problem.rows import JACOBIAN, NEAR


@linked(types.void(WORLD, JACOBIAN, MARKS))
def leave_tied_out(w, jacobian, chosen):
    """Unselect MuJoCo's rows of contacts that are tied, bool (nefc,), see `tied_contacts`; ``chosen`` is written."""
    many = number(w, DATA.ncon)
    if number(w, DATA.ne) == 0 or many == 0:
        return
    address, tied = contact_ints(w, CONTACT.efc_address, 1), cleared(many)
    mark_tied(w, flags(w.bilateral, size(w, MODEL.neq)), jacobian, tied)
    for c in range(many):
        if tied[c]:
            chosen[address[c, 0]] = False


@plain
def _is_near(w, row, jacobian, one, other, reach):
    gap, first, second, (nnz, adr, col, J) = row_floats(w, DATA.efc_pos)[row], 0.0, 0.0, jacobian
    if gap <= NEAR:
        return True
    for k in range(adr[row], adr[row] + nnz[row]):
        first += J[k] * one[col[k]]
        second += J[k] * other[col[k]]
    return gap + reach * min(first, second) < 0.0


@plain
def _find_near(w, jacobian, one, other, reach, near):
    """Write which of MuJoCo's rows begin a contact or limit that is closed or would soon be, bool (nefc,).

    The condition is ``gap + reach min(J v, 0) < 0`` for one of two velocities, (nv,), within a time, s. All rows of
    other kinds are included; all contacts are if surfaces move, which come near to bodies that do not.
    """
    kinds, address = row_ints(w, DATA.efc_type), contact_ints(w, CONTACT.efc_address, 1)
    every = surfaces_move(w)
    for row in range(len(kinds)):
        near[row] = every or kinds[row] <= 2
        if not every and (kinds[row] == 3 or kinds[row] == 4):
            near[row] = _is_near(w, row, jacobian, one, other, reach)
    for k in range(len(address)):
        row = np.int64(address[k, 0])
        if row >= 0 and not every:
            near[row] = _is_near(w, row, jacobian, one, other, reach)
    leave_tied_out(w, jacobian, near)


@linked(types.void(WORLD, JACOBIAN, NUMBERS, BOOLEAN, *[MARKS] * 3), counts=False)
def look(w, jacobian, middle, doubts, chosen, seen, doubtful):
    """Write which rows the velocity of data closes, (nefc,); for the arguments see `choose`, which returns `doubts`."""
    _find_near(w, jacobian, velocity_of(w), velocity_of(w), w.timestep, seen)
    if doubts:
        pass_over(w, jacobian, middle, chosen, seen, doubtful)


@linked(BOOLEAN(WORLD, JACOBIAN, *[NUMBERS] * 3, *[MARKS] * 3), counts=False)
def choose(w, jacobian, start, free, middle, chosen, seen, doubtful):
    """Write which of MuJoCo's rows take part at first, (nefc,); return whether contacts are left out as doubtful.

    Contacts that are far from closing are left out, and those that bodies may pass over, see `passed_edges`.

    Args:
        w: the world in the middle of the step; qvel is the velocity without contact.
        jacobian: `access.jacobian_of`.
        start: velocity at the start, (nv,).
        free: velocity without contact, (nv,).
        middle: position in the middle of the step, (nq,).
        chosen: written.
        seen: scratch space, bool (nefc,).
        doubtful: contacts that bodies may pass over, False, (ncon,), written.
    """
    _find_near(w, jacobian, start, free, 2.0 * w.timestep, chosen)
    passes = some_can_pass(w, chosen)
    doubts = passes and leave_fast(w, start, chosen, doubtful)
    if doubts:
        look(w, jacobian, middle, doubts, chosen, seen, doubtful)
        take_back(w, chosen, seen, doubtful)
    return (passes and leave_edges(w, chosen, doubtful)) or doubts
