"""Limits that close because equality constraints drift, in compiled code; see `soft.drifting_limits`."""

from __future__ import annotations

import numpy as np
from numba import types

from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.linked import linked
from impactlaw.mechanics.tolerances import FIXED
from impactlaw.scene.equality_constraints import CALM, DRIFT, HELD_BY_DRIFT
from impactlaw.solvers.cones.algebra.loops import FIRST, FLOATS, dot, numbers, plain
from impactlaw.stepping.compiled.access import inertia_of, number, velocity_of
from impactlaw.stepping.compiled.fields import DATA
from impactlaw.stepping.compiled.left_out.tied_contacts import leave_out
from impactlaw.stepping.compiled.whitening import whitened
from impactlaw.stepping.soft.compiled.contacts.equalities import whitened_row
from impactlaw.stepping.soft.compiled.contacts.kinds import FOUND, GRADIENTS, WORLD


@plain
def _normal(found, i, jacobian, inertia, root, row, out):
    """Write the whitened gradient of a gap, (nv,); `row` is scratch space, (nv,)."""
    whitened_row(jacobian, found.row[i], inertia, root, out)
    if found.paired[i]:
        whitened_row(jacobian, found.row[i] + 1, inertia, root, row)
        for k in range(len(out)):
            out[k] = 0.5 * (out[k] + row[k])


@plain
def _fastest(left, lengths, allowed, i, nv):
    """Return the speed, in the kinetic metric, of the fastest contact that the allowed motion of contact i reaches."""
    fastest = 0.0
    for j in range(len(lengths)):
        if abs(dot(left, i * nv, left, j * nv, nv)) > INFLUENCE * lengths[i] * lengths[j]:
            fastest = max(fastest, abs(allowed[j]) / lengths[j])
    return fastest


@plain
def _acts(found, gamma, left, lengths, before, allowed, i, nv):
    """Return whether a contact or limit takes part in collisions."""
    if found.contact[i] >= 0 or lengths[i] == 0.0 or lengths[i] > HELD_BY_DRIFT * before[i]:
        return True
    rest = DRIFT * lengths[i] * _fastest(left, lengths, allowed, i, nv)
    return abs(gamma[i] - allowed[i]) <= max(CALM * abs(allowed[i]), rest)


@plain
def _keep(found, gamma, left, lengths, before, allowed, nv):
    """Move contacts and limits that act to the front, with their velocities, and return their number."""
    count = 0
    for i in range(len(lengths)):
        if _acts(found, gamma, left, lengths, before, allowed, i, nv):
            found.row[count], found.contact[count] = found.row[i], found.contact[i]
            found.paired[count], gamma[count] = found.paired[i], gamma[i]
            count += 1
    return count


@linked(types.int64(WORLD, GRADIENTS, FOUND, FLOATS))
def leave_drifting_out(w, gradients, found, gamma):
    """Leave out limits that close because constraints drift: move the others to the front, and return their number.

    Args:
        w: the world.
        gradients: those of its contacts and constraints, some of which keep their velocity.
        found: contacts and limits, limits first, written.
        gamma: contact velocities, (h,), written.
    """
    (jacobian, root, basis), nv, many, limits = gradients, w.nv, len(gamma), number(w, DATA.nl)
    inertia, left, row, v, held = inertia_of(w), numbers(many * nv), numbers(nv), numbers(nv), False
    lengths, before, allowed = numbers(many), numbers(many), numbers(many)
    whitened(velocity_of(w), inertia, root, v)
    for i in range(many):
        if i == limits and not held:  # contacts are needed only to compare limits with them
            return many
        at = i * nv
        _normal(found, i, jacobian, inertia, root, row, left[at : at + nv])
        before[i] = np.sqrt(dot(left, at, left, at, nv))
        part = leave_out(basis, len(basis) // nv, nv, left, at)
        lengths[i] = part * before[i] if part > FIXED else 0.0
        allowed[i] = dot(left, at, v, FIRST, nv)
        held = held or 0.0 < lengths[i] <= HELD_BY_DRIFT * before[i]
    return _keep(found, gamma, left, lengths, before, allowed, nv)
