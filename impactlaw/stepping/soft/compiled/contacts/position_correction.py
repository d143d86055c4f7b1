"""Move colliding bodies where MuJoCo's contacts would push beside the law, compiled; see `soft.position_correction`."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import FLOATS, indices, kernel, numbers, plain, zeros
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_floats,
    contact_ints,
    data_at,
    data_floats,
    data_ints,
    jacobian_of,
    model_floats,
    model_ints,
    number,
    offset,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, float_at, keep
from impactlaw.stepping.compiled.islands import join_trees, tree_of
from impactlaw.stepping.soft.compiled.contacts.active_contacts import find, normal_velocities
from impactlaw.stepping.soft.compiled.contacts.kinds import LAW, WORLD
from impactlaw.stepping.soft.position_correction import ROUND
from impactlaw.stepping.soft.tolerances import JUST_CLOSED, OPENING

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


@plain
def _push(w, found, i, wanted):
    """Return the normal acceleration that a contact by itself asks for, m/s^2; at 0 or less it does not push."""
    row, contact = found.row[i], found.contact[i]
    if contact < 0:
        return wanted[row]
    sliding = contact_ints(w, CONTACT.dim, 1)[contact, 0] - 1
    if found.paired[i]:
        most = wanted[row]
        for r in range(row, row + 2 * sliding):
            most = max(most, wanted[r])
        return most
    friction, square = contact_floats(w, CONTACT.friction, 5), 0.0
    for k in range(sliding):
        square += (friction[contact, k] * wanted[row + 1 + k]) ** 2
    return wanted[row] + np.sqrt(square)


@plain
def _find_wanted(w, after, wanted):
    """Write the reference accelerations that rows would have at the velocities `after`, (nefc,)."""
    n = number(w, DATA.nefc)
    table, gap, margin = (
        data_floats(w, DATA.efc_KBIP, (n, 4)),
        data_floats(w, DATA.efc_pos, n),
        data_floats(w, DATA.efc_margin, n),
    )
    for r in range(n):
        wanted[r] = table[r, 0] * table[r, 2] * (margin[r] - gap[r]) - table[r, 1] * after[r]


@plain
def _since(w, law, found, i, closing, opening, wanted):
    """Return the time since a contact has closed, at most a timestep; 0 if it does not open, or is not pushed."""
    row, n = found.row[i], number(w, DATA.nefc)
    depth = data_floats(w, DATA.efc_margin, n)[row] - data_floats(w, DATA.efc_pos, n)[row]
    h = float_at(w.model + offset(w, MODEL.opt_timestep))
    fresh = 0.0 < depth < -JUST_CLOSED * h * closing[i]
    if not (closing[i] < -law.rest_speed and opening[i] > OPENING * law.rest_speed and fresh):
        return 0.0
    if not _push(w, found, i, wanted) > 0.0:
        return 0.0
    return min(depth / -closing[i], h)


@kernel
def _keep_spin(w, qvel, move):
    """Keep the angular velocity, in the axes of the world, of round free bodies that a move, (nv,), has turned."""
    joints, back, axis, spin = size(w, MODEL.njnt), numbers(4), numbers(3), numbers(3)
    kind, first = model_ints(w, MODEL.jnt_type, joints), model_ints(w, MODEL.jnt_dofadr, joints)
    simple, inertia = model_ints(w, MODEL.dof_simplenum, w.nv), model_floats(w, MODEL.dof_M0, w.nv)
    for j in range(joints):
        a = first[j] + 3
        if kind[j] != _FREE or not simple[first[j]]:
            continue
        angle = np.sqrt(move[a] ** 2 + move[a + 1] ** 2 + move[a + 2] ** 2)
        most = max(inertia[a], inertia[a + 1], inertia[a + 2])
        if angle > 0.0 and most - min(inertia[a], inertia[a + 1], inertia[a + 2]) <= ROUND * most:
            for k in range(3):
                axis[k], spin[k] = move[a + k] / angle, qvel[a + k]
            mj.axis_angle_to_quat(address_of(back), address_of(axis), -angle)
            mj.rotate(address_of(qvel) + 8 * a, address_of(spin), address_of(back))
    keep(back)
    keep(axis)
    keep(spin)


@kernel
def _move(w, found, since, before):
    """Move each island by its change of velocity times the longest time since one of its contacts has closed."""
    n, many, tree = number(w, DATA.nefc), size(w, MODEL.ntree), model_ints(w, MODEL.dof_treeid, w.nv)
    (nnz, adr, col, val), island, longest = jacobian_of(w, True), indices(many), zeros(many)
    join_trees(data_ints(w, DATA.efc_type, n), data_ints(w, DATA.efc_id, n), nnz, adr, col, val, tree, island)
    for i in range(len(since)):
        if since[i] > 0.0:
            t = island[tree_of(nnz, adr, col, val, found.row[i], tree)]
            longest[t] = max(longest[t], since[i])
    qvel, change = velocity_of(w), numbers(w.nv)
    for k in range(w.nv):
        change[k] = longest[island[tree[k]]] * (qvel[k] - before[k])
    mj.integrate_pos(w.model, data_at(w, DATA.qpos), address_of(change), 1.0)
    _keep_spin(w, qvel, change)
    keep(change)
    mj.fwd_position(w.model, w.data)


@linked(types.boolean(WORLD, LAW, FLOATS))
def put_back(w, law, before):
    """Put bodies where they would be if the law had acted when their contacts closed, and update positions.

    Args:
        w: the world with the velocity after the collisions; everything else is still as before them.
        law: see `world.Law`.
        before: the velocity before the collisions, (nv,).

    Returns:
        Whether any body has moved; then sensors and energies of positions are not current.
    """
    n, found = number(w, DATA.nefc), find(w, law.bilateral[:0])
    h, after, wanted = len(found.row), numbers(n), numbers(n)
    closing, opening, since, some = numbers(h), numbers(h), numbers(h), False
    mj.mul_jac_vec(w.model, w.data, address_of(after), data_at(w, DATA.qvel))
    keep(after)
    normal_velocities(found, data_floats(w, DATA.efc_vel, n), closing)
    normal_velocities(found, after, opening)
    _find_wanted(w, after, wanted)
    for i in range(h):
        since[i] = _since(w, law, found, i, closing, opening, wanted)
        some = some or since[i] > 0.0
    if some:
        _move(w, found, since, before)
    return some
