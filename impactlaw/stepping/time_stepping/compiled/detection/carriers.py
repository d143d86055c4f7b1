"""The motion of mocap bodies around the middle of a step, which carry geoms and other bodies."""

from __future__ import annotations

from impactlaw.solvers.cones.algebra.loops import kernel, norm, numbers, put
from impactlaw.solvers.cones.algebra.vectors import cross, dot, minus, plus, row
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import contact_ints, contacts_of, data_floats, model_ints, offset, size
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, floats, keep, long_at
from impactlaw.stepping.time_stepping.compiled.state.surfaces import ROW, velocities_of


@kernel
def carrier_of(w, geom):
    """Return the mocap body that carries a geom, or -1."""
    if geom < 0:
        return -1
    nbody, body = size(w, MODEL.nbody), model_ints(w, MODEL.geom_bodyid, size(w, MODEL.ngeom))[geom]
    return model_ints(w, MODEL.body_mocapid, nbody)[model_ints(w, MODEL.body_rootid, nbody)[body]]


@kernel
def carried(w, body, point, at):
    """Return the velocity at which a mocap body, or -1, carries a point, m/s; `at` is its place in `surfaces.Row`."""
    velocity = velocities_of(w, at)
    if body < 0 or len(velocity) == 0:
        return 0.0, 0.0, 0.0
    place = data_floats(w, DATA.mocap_pos, (size(w, MODEL.nmocap), 3))
    return plus(row(velocity, body), 1.0, cross(velocity[body, 3:], minus(point, row(place, body))))


@kernel
def add_surfaces(w, rows):
    """Add the velocities of mocap bodies to those of contact rows, relative to each other."""
    (_, point, frame, geom), address = contacts_of(w), contact_ints(w, CONTACT.efc_address, 1)[:, 0]
    velocity = velocities_of(w, ROW.now)
    for g in range(len(rows.key)):
        c, first = rows.groups[3, g], rows.groups[0, g]
        for side in range(2 if c >= 0 else 0):
            body = carrier_of(w, geom[c, side])
            if body < 0:
                continue
            moved, sign = carried(w, body, row(point, c), ROW.now), 2.0 * side - 1.0
            for r in range(first, first + rows.groups[1, g]):
                k = rows.sparse[2, r] - address[c]
                along = sign * dot(frame[c, 3 * (k % 3) :], moved if k < 3 else row(velocity[:, 3:], body))
                rows.rates[1, r] += along
                rows.rates[2, r] += along


@kernel
def carry_on(w, time):
    """Move mocap bodies of other data to where they are after some time."""
    m, axis, moved, velocity = size(w, MODEL.nmocap), numbers(3), numbers(4), velocities_of(w, ROW.now)
    position = floats(long_at(w.scratch + offset(w, DATA.mocap_pos)), (m, 3))
    quaternion = floats(long_at(w.scratch + offset(w, DATA.mocap_quat)), (m, 4))
    place, turn = data_floats(w, DATA.mocap_pos, (m, 3)), data_floats(w, DATA.mocap_quat, (m, 4))
    for b in range(m):
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
