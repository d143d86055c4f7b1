"""Contacts and limits that MuJoCo's solver acts on, in compiled code, and those that a collision can reach."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw.scene.tolerances import OUT_OF_REACH
from impactlaw.solvers.cones.algebra.loops import cleared, indices, kernel, numbers, once, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    bodies_of,
    contact_ints,
    contacts_of,
    data_at,
    data_floats,
    jacobian_of,
    model_ints,
    number,
    offset,
    option,
    shapes_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, float_at, keep
from impactlaw.stepping.compiled.left_out.hidden_edges import hide_edges
from impactlaw.stepping.compiled.left_out.tied_contacts import mark_tied
from impactlaw.stepping.integration import STEP_STATE
from impactlaw.stepping.soft import pressed_contacts
from impactlaw.stepping.soft.compiled.world import World

Array = np.ndarray[Any, Any]

approach_speed = plain(pressed_contacts.approach_speed)
_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)


class ActiveContacts(NamedTuple):
    """The contacts and limits that MuJoCo's solver acts on."""

    row: Array  # muJoCo's first row, int64 (h,)
    contact: Array  # index among MuJoCo's contacts, -1 for a limit, int64 (h,)
    paired: Array  # whether the contact is a pyramid: pairs of rows, the mean of which is the normal, int64 (h,)


@plain
def _list(w, left_out, row, contact, paired):
    """Write the fields of `ActiveContacts`, and return the number of contacts and limits."""
    limits, first, many = number(w, DATA.nl), number(w, DATA.ne) + number(w, DATA.nf), number(w, DATA.ncon)
    address, dim = contact_ints(w, CONTACT.efc_address, 1)[:, 0], contact_ints(w, CONTACT.dim, 1)[:, 0]
    pyramidal, h = option(w, MODEL.opt_cone) == _PYRAMIDAL, limits
    for i in range(limits):
        row[i], contact[i], paired[i] = first + i, -1, 0
    for i in range(many):
        if address[i] >= 0 and not left_out[i]:
            row[h], contact[h], paired[h] = address[i], i, pyramidal and dim[i] > 1
            h += 1
    return h


@plain
def _mark_hidden(w, gap, hidden):
    """Mark contacts with edges, see `hidden_edges.hide_edges`; gap is scratch space. Both are (ncon,)."""
    (dist, pos, frame, geom), (body, weld, tree) = contacts_of(w), bodies_of(w)
    put(gap, dist)
    hide_edges(gap, pos, frame, geom, body, weld, tree, shapes_of(w), (w.model, w.data))
    for i in range(len(gap)):
        hidden[i] = hidden[i] or gap[i] == OUT_OF_REACH


@once
def find(w, constraints):
    """Return the current contacts and limits, as arrays that are valid until the function that calls this returns.

    Contacts that equality constraints tie are left out, see `tied_contacts`; `constraints` are the kinds of these,
    uint8 (neq,), or (0,) to leave out none of them. So are contacts with hidden edges, see `hidden_edges`.
    """
    most = number(w, DATA.nl) + number(w, DATA.ncon)
    row, contact, paired = indices(most), indices(most), indices(most)
    tied, gap = cleared(number(w, DATA.ncon)), numbers(number(w, DATA.ncon))
    if len(constraints) > 0 and number(w, DATA.ne) > 0 and len(tied) > 0:
        jacobian = jacobian_of(w, True)
        mark_tied(w, constraints, jacobian, tied)
    if len(tied) > 1:
        _mark_hidden(w, gap, tied)
    h = _list(w, tied, row, contact, paired)
    return ActiveContacts(row[:h], contact[:h], paired[:h])


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
def _pairs_before(w, start):
    """Return the geoms of the contacts a step before, int32 (n, 2)."""
    if start.data == 0:
        return start.pairs
    before, h = World(w.model, start.data, w.table, w.nv), float_at(w.model + offset(w, MODEL.opt_timestep))
    mj.set_state(w.model, start.data, address_of(start.state), STEP_STATE)
    keep(start.state)
    mj.integrate_pos(w.model, data_at(before, DATA.qpos), data_at(w, DATA.qvel), -h)
    mj.kinematics(w.model, start.data)
    mj.collision(w.model, start.data)
    return contact_ints(before, CONTACT.geom, 2).copy()


@kernel
def _look_back(w, found, gamma, rest_speed, start, approach):
    """Do what `soft.collisions.Collisions._approach` does with contacts that seem to be deep."""
    geoms, pairs, looked = contact_ints(w, CONTACT.geom, 2), start.pairs, False
    for i in range(len(gamma)):
        c = found.contact[i]
        if c >= 0 and approach[i] > rest_speed:
            if not looked:
                pairs, looked = _pairs_before(w, start), True
            was = False
            for pair in pairs:
                was = was or (pair[0] == geoms[c, 0] and pair[1] == geoms[c, 1])
            if not was:
                approach[i] = rest_speed


@kernel
def approach_speeds(w, found, gamma, rest_speed, start, approach):
    """Write the closing speeds above which contacts collide, (h,), see `soft.pressed_contacts`; gamma is (h,)."""
    n, h = number(w, DATA.nefc), float_at(w.model + offset(w, MODEL.opt_timestep))
    rows, last = numbers(n), numbers(len(gamma))
    mj.mul_jac_vec(w.model, w.data, address_of(rows), data_at(w, DATA.qacc_warmstart))
    keep(rows)
    normal_velocities(found, rows, last)
    gap, margin = data_floats(w, DATA.efc_pos, n), data_floats(w, DATA.efc_margin, n)
    for i in range(len(gamma)):
        row = found.row[i]
        approach[i] = approach_speed(gamma[i], last[i], margin[row] - gap[row], h, rest_speed)
    _look_back(w, found, gamma, rest_speed, start, approach)


@plain
def some_collides(gamma, approach):
    """Return whether a contact closes faster than its speed in `approach`, (h,)."""
    some = False
    for i in range(len(gamma)):
        some = some or gamma[i] < -approach[i]
    return some


@plain
def _meets(jacobian, row, tree, mark):
    """Return whether a row of MuJoCo acts on a marked tree."""
    nnz, adr, col, val = jacobian
    for a in range(adr[row], adr[row] + nnz[row]):
        if val[a] != 0.0 and mark[tree[col[a]]]:
            return True
    return False


@plain
def _mark(jacobian, row, tree, mark):
    """Mark the trees that a row of MuJoCo acts on; return whether one of them was not marked before."""
    nnz, adr, col, val = jacobian
    new = False
    for a in range(adr[row], adr[row] + nnz[row]):
        if val[a] != 0.0 and not mark[tree[col[a]]]:
            mark[tree[col[a]]] = new = True
    return new


@plain
def within_reach(w, found, jacobian, gamma, approach, rounding, mark, reached):
    """Find the contacts that do not separate and that chains of shared trees connect to a contact that collides.

    Equality constraints join the trees that they act on.

    Args:
        w: the world.
        found: its contacts.
        jacobian: MuJoCo's rows, see `access.jacobian_of`.
        gamma: contact velocities, (h,).
        approach: closing speeds above which contacts collide, m/s or rad/s, (h,).
        rounding: contact velocity up to which a contact does not separate, m/s or rad/s.
        mark: marks of trees, all False before, bool (ntree,), written.
        reached: the contacts found, all False before, bool (h,), written.
    """
    tree, more = model_ints(w, MODEL.dof_treeid, w.nv), True
    while more:
        more = False
        for i in range(len(gamma)):
            row = found.row[i]
            if (
                not reached[i]
                and gamma[i] <= rounding
                and (gamma[i] < -approach[i] or _meets(jacobian, row, tree, mark))
            ):
                reached[i] = more = True
                _mark(jacobian, row, tree, mark)
        for row in range(number(w, DATA.ne)):
            if _meets(jacobian, row, tree, mark):
                more = _mark(jacobian, row, tree, mark) or more
