"""The motion of mocap bodies around the middle of a step, which carry geoms and other bodies."""

from __future__ import annotations

from impactlaw.solvers.cones.algebra.loops import kernel, norm, numbers, plain, put
from impactlaw.solvers.cones.algebra.vectors import cross, dot, minus, plus, row
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.fields import address_of, keep


@plain
def carried_at(body, point, place, velocity):
    """Return the velocity at which a mocap body carries a point, m/s.

    Args:
        body: index of the mocap body, or -1.
        point: m, (3,).
        place: positions of mocap bodies, m, (nmocap, 3).
        velocity: their velocities, (nmocap, 6), or (0, 6) if none moves.
    """
    if body < 0 or len(velocity) == 0:
        return 0.0, 0.0, 0.0
    return plus(row(velocity, body), 1.0, cross(velocity[body, 3:], minus(point, row(place, body))))


@plain
def carried(g, point, geometry, carriers):
    """Return the velocity at which a mocap body carries a point of a geom, m/s.

    Of mocap bodies, ``carriers`` has positions, quaternions, (nmocap, 4), and velocities, see `carried_at`.
    """
    (_, body_of_geom, _, _, root, mocap), (place, _, velocity) = geometry, carriers
    return carried_at(mocap[root[body_of_geom[g]]], point, place, velocity)


@plain
def add_carried(rows, contacts, bodies, place, velocity):
    """Add the velocities of mocap bodies to those of contact rows, relative to each other.

    Args:
        rows: see `rows.Rows`; velocities are written.
        contacts: points, frames, geoms and first rows of MuJoCo's contacts.
        bodies: MuJoCo's geom_bodyid, body_rootid and body_mocapid.
        place: see `carried_at`, like the next one.
        velocity: velocities of mocap bodies.
    """
    (point, frame, geom, address), (body_of_geom, root, mocap) = contacts, bodies
    for g in range(len(rows.key)):
        c, first = rows.groups[3, g], rows.groups[0, g]
        for side in range(2 if c >= 0 else 0):
            body = -1 if geom[c, side] < 0 else mocap[root[body_of_geom[geom[c, side]]]]
            if body < 0:
                continue
            moved, sign = carried_at(body, row(point, c), place, velocity), 2.0 * side - 1.0
            for r in range(first, first + rows.groups[1, g]):
                k = rows.sparse[2, r] - address[c]
                along = sign * dot(frame[c, 3 * (k % 3) :], moved if k < 3 else row(velocity[:, 3:], body))
                rows.rates[1, r] += along
                rows.rates[2, r] += along


@kernel
def carry_on(carriers, time, position, quaternion):
    """Write where mocap bodies are after some time, m, (nmocap, 3), and their quaternions, (nmocap, 4)."""
    (place, turn, velocity), axis, moved = carriers, numbers(3), numbers(4)
    for b in range(len(place)):
        put(position[b], place[b])
        put(quaternion[b], turn[b])
    for b in range(len(velocity)):
        for i in range(3):
            position[b, i] += time * velocity[b, i]
            axis[i] = time * velocity[b, 3 + i]
        angle = norm(axis)
        if angle > 0.0:
            for i in range(3):
                axis[i] /= angle
            mj.axis_angle_to_quat(address_of(moved), address_of(axis), angle)
            mj.mul_quat(address_of(quaternion[b]), address_of(moved), address_of(turn[b]))
    keep(axis)
    keep(moved)
