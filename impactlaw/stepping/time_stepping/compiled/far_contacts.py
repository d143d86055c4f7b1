"""Contacts that bodies cannot close in the step, in compiled code; see `problem.detection.far_contacts`."""

from __future__ import annotations

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import norm, plain
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_ints,
    contacts_of,
    data_floats,
    model_ints,
    offset,
    shapes_of,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, floats
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.surfaces import surface_speed
from impactlaw.stepping.time_stepping.problem.detection import far_contacts


@plain
def _contacts(w):
    """Return the first arguments of `far_contacts.leave_far_out`."""
    n, (dist, pos, _, geom), kind = size(w, MODEL.nbody), contacts_of(w), shapes_of(w)[0]
    left_out, address = contact_ints(w, CONTACT.exclude, 1)[:, 0], contact_ints(w, CONTACT.efc_address, 1)[:, 0]
    root, center = model_ints(w, MODEL.body_rootid, n), data_floats(w, DATA.subtree_com, (n, 3))
    bodies = model_ints(w, MODEL.geom_bodyid, len(kind)), root, floats(w.sizes, n), center
    return (dist, pos, geom, left_out, address), bodies, kind


@plain
def leave_far_out(w, now):
    """Mark contacts that are too far away at velocities of bodies, ``now``, (nbody, 6), and those of data.

    Return whether there are any.
    """
    contacts, bodies, shape = _contacts(w)
    led_to, gravity = data_floats(w, DATA.cvel, now.shape), floats(w.model + offset(w, MODEL.opt_gravity), 3)
    moves = now, led_to, surface_speed(w), w.timestep, norm(gravity)
    return far_contacts.leave_far_out(contacts, bodies, shape, *moves)


@plain
def far_ones_close(w):
    """Return whether a contact left out can close at the velocities of bodies in data."""
    contacts, bodies, shape = _contacts(w)
    velocity = data_floats(w, DATA.cvel, (size(w, MODEL.nbody), 6))
    return far_contacts.some_close(contacts, bodies, shape, velocity, w.timestep)


@linked(BOOLEAN(WORLD, NUMBERS), counts=False)
def take_far_back(w, start):
    """Take contacts back that were left out if forces can close one; return whether rows must be made again.

    The velocity of data is that without contact, ``start``, (nv,), that at the start of the step.
    """
    contacts, bodies, shape = _contacts(w)
    if not far_contacts.some_are_out(contacts[3]):
        return False
    velocity, qvel = data_floats(w, DATA.cvel, (size(w, MODEL.nbody), 6)), velocity_of(w)
    mj.com_vel(w.model, w.data)
    taken = far_contacts.take_back(contacts, bodies, shape, velocity, w.timestep)
    for i in range(w.nv):
        qvel[i], start[i] = start[i], qvel[i]
    mj.com_vel(w.model, w.data)
    for i in range(w.nv):
        qvel[i], start[i] = start[i], qvel[i]
    return taken
