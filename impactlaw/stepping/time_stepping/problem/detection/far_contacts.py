"""Leave contacts out that bodies cannot close in the step, before MuJoCo makes their rows.

Margins are those of whole bodies, in every direction: they cover the way of the fastest point of each. Seen from a
point of contact, two bodies mostly approach each other by much less. A leg that swings finds hundreds of contacts with
the rest of a dog, of which a few can close. Forces or a collision may change that: contacts left out are looked at
again with the velocities to which these lead, see `take_back` and `some_close`.
"""

from __future__ import annotations

import mujoco

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.algebra.vectors import cross, length, minus, plus, row
from impactlaw.stepping.time_stepping.margins import LEAST, SLACK

_PLANE, _FIELD, _SPHERE = (int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "HFIELD", "SPHERE"))
_FEW = 12
"""Number of contacts up to which all of them take part: their rows cost less than another look at them."""
_FAR = 1
"""MuJoCo's mark of a contact without rows; it has marks of its own for other reasons, which stay."""


@plain
def jump_speed(one, other, shapes, sizes, velocity):
    """Return how fast a contact gets deeper by jumping to another point of the smaller of two bodies, m/s.

    Args:
        one: the first body.
        other: the other body.
        shapes: MuJoCo's geom_type of the two geoms.
        sizes: sizes of the two bodies, m, see `margins.write_sizes`.
        velocity: MuJoCo's cvel, (nbody, 6).
    """
    if shapes[0] == _SPHERE or shapes[1] == _SPHERE:
        return 0.0
    endless = shapes[0] == _PLANE or shapes[1] == _PLANE or shapes[0] == _FIELD or shapes[1] == _FIELD
    arm = max(sizes) if endless else min(sizes)
    return 2.0 * arm * length(minus(row(velocity, one), row(velocity, other)))


@plain
def _speed(k, contacts, bodies, shape, velocity):
    """Return how fast the two bodies of a contact can approach each other there, m/s."""
    (_, pos, geom, _, _), (body_of_geom, root, size, subtree) = contacts, bodies
    a, b = body_of_geom[geom[k, 0]], body_of_geom[geom[k, 1]]
    one = cross(velocity[a], minus(row(pos, k), row(subtree, root[a])))
    other = cross(velocity[b], minus(row(pos, k), row(subtree, root[b])))
    v = plus(minus(velocity[a, 3:], velocity[b, 3:]), 1.0, minus(one, other))
    shapes = shape[geom[k, 0]], shape[geom[k, 1]]
    return length(v) + 0.5 * jump_speed(a, b, shapes, (size[a], size[b]), velocity)


@plain
def leave_far_out(contacts, bodies, shape, now, led_to, surface_speed, timestep, gravity):
    """Mark contacts that are too far away to close, if there are many; return whether there are any.

    Their gaps are more than `SLACK` times the way in a timestep at each of two velocities.

    Args:
        contacts: gaps, m, (ncon,), points, (ncon, 3), geoms, (ncon, 2), and MuJoCo's exclude and
            efc_address, (ncon,), both written.
        bodies: MuJoCo's geom_bodyid and body_rootid, sizes of bodies, and subtree_com.
        shape: MuJoCo's geom_type, (ngeom,).
        now: MuJoCo's cvel, (nbody, 6).
        led_to: cvel for the velocity to which forces lead without contact, (nbody, 6).
        surface_speed: speed of the fastest point of mocap bodies, m/s.
        timestep: h, s.
        gravity: magnitude of gravity, m/s^2.
    """
    (dist, _, _, exclude, address), some = contacts, False
    ratio, least = SLACK * timestep, SLACK * timestep * timestep * gravity + LEAST
    for k in range(len(dist) if len(dist) > _FEW else 0):
        if exclude[k] == 0 and dist[k] > least + ratio * surface_speed:
            before, after = _speed(k, contacts, bodies, shape, now), _speed(k, contacts, bodies, shape, led_to)
            if dist[k] > least + ratio * (surface_speed + max(before, after)):
                exclude[k], address[k], some = _FAR, -1, True
    return some


@plain
def some_close(contacts, bodies, shape, velocity, timestep):
    """Return whether a contact left out can close in a timestep; for the arguments see `leave_far_out`."""
    (dist, _, _, exclude, _), some = contacts, False
    for k in range(len(dist)):
        if exclude[k] == _FAR and not some:
            some = dist[k] < timestep * _speed(k, contacts, bodies, shape, velocity)
    return some


@plain
def take_back(contacts, bodies, shape, velocity, timestep):
    """Take contacts back that were left out, if forces can close one; return whether they are.

    The velocity is that without contact. For the arguments see `leave_far_out`.
    """
    if not some_close(contacts, bodies, shape, velocity, timestep):
        return False
    exclude = contacts[3]
    for k in range(len(exclude)):
        exclude[k] = 0 if exclude[k] == _FAR else exclude[k]
    return True


@plain
def some_are_out(exclude):
    """Return whether any contact is left out."""
    some = False
    for k in range(len(exclude)):
        some = some or exclude[k] == _FAR
    return some
