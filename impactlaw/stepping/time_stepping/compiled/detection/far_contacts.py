"""Leave contacts out that bodies cannot close in the step, before MuJoCo makes their rows.

Margins are those of whole bodies, in every direction: they cover the way of the fastest point of each. Seen from a
point of contact, two bodies mostly approach each other by much less. A leg that swings finds hundreds of contacts with
the rest of a dog, of which a few can close. Forces or a collision may change that: contacts left out are looked at
again with the velocities to which these lead, see `take_far_back` and `far_ones_close`.
"""

from __future__ import annotations

import mujoco

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import norm, plain
from impactlaw.solvers.cones.algebra.vectors import cross, length, minus, plus, row
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import contact_ints, contacts_of, data_floats, model_ints, offset, size
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, floats
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.surfaces import surface_speed
from impactlaw.stepping.time_stepping.compiled.state.world import move_bodies
from impactlaw.stepping.time_stepping.tolerances import LEAST, SLACK

_PLANE, _FIELD, _SPHERE = (int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "HFIELD", "SPHERE"))
_FEW = 12
"""Number of contacts up to which all of them take part: their rows cost less than another look at them."""
_FAR = 1
"""MuJoCo's mark of a contact without rows; it has marks of its own for other reasons, which stay."""


@plain
def jump_speed(w, one, other, velocity):
    """Return how fast a contact of two geoms gets deeper by jumping to another point of the smaller body, m/s.

    ``velocity`` is MuJoCo's cvel, (nbody, 6).
    """
    n, sizes = size(w, MODEL.ngeom), floats(w.sizes, size(w, MODEL.nbody))
    kind, body = model_ints(w, MODEL.geom_type, n), model_ints(w, MODEL.geom_bodyid, n)
    first, second, a, b = kind[one], kind[other], body[one], body[other]
    if first == _SPHERE or second == _SPHERE:
        return 0.0
    endless = first == _PLANE or second == _PLANE or first == _FIELD or second == _FIELD
    arm = max(sizes[a], sizes[b]) if endless else min(sizes[a], sizes[b])
    return 2.0 * arm * length(minus(row(velocity, a), row(velocity, b)))


@plain
def _speed(w, k, velocity):
    """Return how fast the two bodies of a contact can approach each other there, m/s, for MuJoCo's cvel, (nbody, 6)."""
    n, (_, pos, _, geom) = size(w, MODEL.nbody), contacts_of(w)
    root, subtree = model_ints(w, MODEL.body_rootid, n), data_floats(w, DATA.subtree_com, (n, 3))
    body = model_ints(w, MODEL.geom_bodyid, size(w, MODEL.ngeom))
    a, b = body[geom[k, 0]], body[geom[k, 1]]
    one = cross(velocity[a], minus(row(pos, k), row(subtree, root[a])))
    other = cross(velocity[b], minus(row(pos, k), row(subtree, root[b])))
    v = plus(minus(velocity[a, 3:], velocity[b, 3:]), 1.0, minus(one, other))
    return length(v) + 0.5 * jump_speed(w, geom[k, 0], geom[k, 1], velocity)


@plain
def leave_far_out(w, now):
    """Mark contacts that are too far away to close, if there are many; return whether there are any.

    Their gaps are more than `SLACK` times the way in a timestep at velocities of bodies, ``now``, (nbody, 6), and also
    at those of data, to which forces lead without contact.
    """
    dist, exclude = contacts_of(w)[0], contact_ints(w, CONTACT.exclude, 1)
    address, some = contact_ints(w, CONTACT.efc_address, 1), False
    led_to, gravity = data_floats(w, DATA.cvel, now.shape), norm(floats(w.model + offset(w, MODEL.opt_gravity), 3))
    h, fastest = w.timestep, surface_speed(w)
    ratio, least = SLACK * h, SLACK * h * h * gravity + LEAST
    for k in range(len(dist) if len(dist) > _FEW else 0):
        if exclude[k, 0] == 0 and dist[k] > least + ratio * fastest:
            if dist[k] > least + ratio * (fastest + max(_speed(w, k, now), _speed(w, k, led_to))):
                exclude[k, 0], address[k, 0], some = _FAR, -1, True
    return some


@plain
def far_ones_close(w):
    """Return whether a contact left out can close in a timestep at the velocities of bodies in data."""
    dist, exclude = contacts_of(w)[0], contact_ints(w, CONTACT.exclude, 1)
    velocity = data_floats(w, DATA.cvel, (size(w, MODEL.nbody), 6))
    for k in range(len(dist)):
        if exclude[k, 0] == _FAR and dist[k] < w.timestep * _speed(w, k, velocity):
            return True
    return False


@linked(BOOLEAN(WORLD, NUMBERS), counts=False)
def take_far_back(w, start):
    """Take contacts back that were left out if forces can close one; return whether rows must be made again.

    The velocity of data is that without contact, ``start``, (nv,), that at the start of the step.
    """
    exclude, some = contact_ints(w, CONTACT.exclude, 1), False
    for k in range(len(exclude)):
        some = some or exclude[k, 0] == _FAR
    if not some:
        return False
    mj.com_vel(w.model, w.data)
    close = far_ones_close(w)
    for k in range(len(exclude) if close else 0):
        exclude[k, 0] = 0 if exclude[k, 0] == _FAR else exclude[k, 0]
    move_bodies(w, start)
    return close
