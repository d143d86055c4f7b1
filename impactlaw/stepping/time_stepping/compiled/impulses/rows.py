"""Read the rows of a step from MuJoCo's, see `problem.rows`."""

from __future__ import annotations

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.scene.tolerances import NO_FRICTION
from impactlaw.solvers.cones import BILATERAL, BOX, CONE
from impactlaw.solvers.cones.algebra.loops import cleared, numbers, plain, zeros
from impactlaw.stepping.compiled.access import contact_floats, contact_ints, layout_of_trees, row_floats, row_ints, size
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL
from impactlaw.stepping.compiled.whitening import INERTIA, whiten
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, MARKS, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.rows import JACOBIAN, ROWS
from impactlaw.stepping.time_stepping.problem.tiny_gaps import close_tiny_gaps

_ROUNDED = 1e-13
"""Part of ``|J| |v|`` up to which the velocity of a row is rounding, and 0.

Bodies that touch and fly together have only such velocities, of which a solver makes a hard problem of friction.
"""
_LIMIT, _CONTACT, _ELLIPTIC = (3, 4), 5, 7  # mjtConstraint; 5 is the first kind of contacts


@plain
def _group(w, row, frictional):
    """Return kind, number of rows without those of no friction, and number of MuJoCo's rows of the group at a row."""
    kind = row_ints(w, DATA.efc_type)[row]
    if kind == 0:
        return BILATERAL, 1, 1
    if kind <= 2:
        return BOX, 1, 1
    if kind != _ELLIPTIC:
        return CONE, 1, 1
    contact, rows, friction = row_ints(w, DATA.efc_id)[row], 1, contact_floats(w, CONTACT.friction, 5)
    dim = contact_ints(w, CONTACT.dim, 1)[contact, 0]
    if frictional:
        for k in range(dim - 1):
            rows += not friction[contact, k] <= NO_FRICTION  # NaN counts: the step must fail, not ignore it
    return CONE, rows, dim


@plain
def count(w, chosen, frictional):
    """Return the number of groups whose first row is chosen, and the number of their rows."""
    groups, rows, row = 0, 0, 0
    while row < len(chosen):
        _, size_of, step = _group(w, row, frictional)
        if chosen[row]:
            groups += 1
            rows += size_of
        row += step
    return groups, rows


@plain
def _side(jacobian, row):
    """Return 2 for a row with a single, positive entry, else 0; this distinguishes both limits of a slide or hinge."""
    entries, side, (nnz, adr, _, J) = 0, 0, jacobian
    for k in range(adr[row], adr[row] + nnz[row]):
        if J[k] != 0.0:
            entries += 1
            side = 2 if J[k] > 0.0 else 0
    return side if entries == 1 else 0


@plain
def _write_group(w, rows, g, r, row, many, kind, jacobian):
    """Write everything of a group that begins at one of MuJoCo's rows, except its rows."""
    of, number_of, amount = row_ints(w, DATA.efc_type)[row], row_ints(w, DATA.efc_id)[row], 0.0
    rows.groups[0, g], rows.groups[1, g], rows.groups[2, g], rows.groups[3, g] = r, many, kind, -1
    side = _side(jacobian, row) if of in _LIMIT else 0
    rows.key[g] = -1 - (np.int64(number_of) * 8 + of + side)
    if kind == BOX:
        amount = w.timestep * row_floats(w, DATA.efc_frictionloss)[row]
    elif kind == BILATERAL:
        amount = row_floats(w, DATA.efc_R)[row]
    rows.amounts[0, g], rows.amounts[1, g] = row_floats(w, DATA.efc_pos)[row] if kind == CONE else 0.0, amount
    if kind == CONE and of >= _CONTACT:
        geoms = contact_ints(w, CONTACT.geom, 2)[number_of]
        rows.groups[3, g], rows.key[g] = number_of, (np.int64(min(geoms[0], geoms[1])) << 32) + max(geoms[0], geoms[1])
    elif kind == CONE:
        rows.groups[3, g] = -2 - row


@plain
def _write_rates(w, rows, r, i, kind, scale, jacobian, velocity, before, free):
    """Write the rates of one of MuJoCo's rows."""
    (nnz, adr, col, J), was, led, size_of, some = jacobian, 0.0, 0.0, 0.0, len(velocity) > 0
    for a in range(adr[i], adr[i] + nnz[i]):
        part = J[a] * free[col[a]]
        was += J[a] * before[col[a]]
        led += part
        size_of += abs(part)
    if kind == CONE and some:  # MuJoCo's velocity includes that of belts
        led += velocity[i] - was
        was = velocity[i]
    if abs(led) <= _ROUNDED * size_of:
        led = 0.0
    rows.rates[0, r], rows.rates[1, r], rows.rates[2, r], rows.rates[3, r], rows.rates[4, r] = scale, was, led, 0.0, 0.0
    rows.rates[5, r] = rows.rates[6, r] = np.nan
    if kind == BILATERAL:
        rows.rates[3, r] = velocity[i] + w.timestep * row_floats(w, DATA.efc_aref)[i] if some else 0.0
        rows.rates[4, r] = row_floats(w, DATA.efc_R)[i]


@linked(types.void(WORLD, JACOBIAN, INERTIA, *[NUMBERS] * 3, MARKS, BOOLEAN, ROWS))
def read(w, jacobian, inertia, velocity, before, free, chosen, frictional, rows):
    """Write the rows of the groups whose first row is chosen.

    Args:
        w: the world with current contacts.
        jacobian: `access.jacobian_of`, without zeros.
        inertia: the mass matrix of the step.
        velocity: velocities of MuJoCo's rows, including belts, (nefc,); (0,) to leave belts out.
        before: velocity at the start of the step, (nv,).
        free: velocity without contact, (nv,).
        chosen: rows of MuJoCo that begin a group that takes part, bool (nefc,).
        frictional: whether rows of friction take part.
        rows: written.
    """
    root, work, mark, trees = numbers(w.nv), zeros(w.nv), cleared(size(w, MODEL.ntree)), layout_of_trees(w)
    (nnz, adr, col, J), friction, number_of = jacobian, contact_floats(w, CONTACT.friction, 5), row_ints(w, DATA.efc_id)
    for i in range(w.nv):
        root[i] = np.sqrt(inertia.inverse[i])
    row, g, r, end = 0, 0, 0, 0
    while row < len(chosen):
        kind, many, step = _group(w, row, frictional)
        if chosen[row]:
            _write_group(w, rows, g, r, row, many, kind, jacobian)
            for k in range(step if frictional else 1):
                i, scale = row + k, 1.0 if k == 0 else friction[number_of[row], k - 1]
                if k > 0 and scale <= NO_FRICTION:
                    continue
                _write_rates(w, rows, r, i, kind, scale, jacobian, velocity, before, free)
                more = whiten(nnz[i], adr[i], col, J, end, work, mark, inertia, root, trees, rows.value, rows.colind)
                rows.sparse[0, r], rows.sparse[1, r], rows.sparse[2, r] = more, end, i
                for a in range(end, end + more):
                    rows.value[a] *= scale
                end += more
                r += 1
            g += 1
        row += step
    close_tiny_gaps(rows, before, free, inertia, trees[0], setting(w, SETTING.touching), root, work)
