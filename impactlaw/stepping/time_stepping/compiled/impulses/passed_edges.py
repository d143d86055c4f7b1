"""Contacts that bodies pass, in compiled code, see `problem.detection.passed_edges`."""

from __future__ import annotations

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.compiled.access import (
    bodies_of,
    contact_ints,
    contacts_of,
    data_floats,
    model_floats,
    model_ints,
    offset,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, address_of, floats, long_at
from impactlaw.stepping.time_stepping.compiled.impulses.forces import move_bodies
from impactlaw.stepping.time_stepping.compiled.state.surfaces import ROW, velocities_of
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.detection.fast_bodies import leave_fast
from impactlaw.stepping.time_stepping.problem.detection.passed_edges import pass_over


@plain
def contacts_at(w):
    """Return the contacts that `leave_fast` takes."""
    return *contacts_of(w), contact_ints(w, CONTACT.efc_address, 1)[:, 0]


@plain
def geometry_of(w):
    """Return the properties of geoms and bodies that `leave_fast` takes."""
    nbody, shape = size(w, MODEL.nbody), model_ints(w, MODEL.geom_type, size(w, MODEL.ngeom))
    return shape, *bodies_of(w), model_ints(w, MODEL.body_rootid, nbody), model_ints(w, MODEL.body_mocapid, nbody)


@plain
def _mocap(w, data):
    m = size(w, MODEL.nmocap)
    at, turned = long_at(data + offset(w, DATA.mocap_pos)), long_at(data + offset(w, DATA.mocap_quat))
    return floats(at, (m, 3)), floats(turned, (m, 4))


@plain
def _carriers(w):
    return *_mocap(w, w.data), velocities_of(w, ROW.now)


@plain
def doubt_fast(w, start, chosen, doubtful):
    """Leave contacts of bodies out that are fast at the start of the step and may miss, see `leave_fast`."""
    if setting(w, SETTING.inertial) != 0.0:
        move_bodies(w, start)  # inertial forces have left velocities of bodies at another velocity
    nbody, extent = size(w, MODEL.nbody), model_floats(w, MODEL.geom_aabb, (size(w, MODEL.ngeom), 6))
    velocity, center = data_floats(w, DATA.cvel, (nbody, 6)), data_floats(w, DATA.subtree_com, (nbody, 3))
    motion = velocity, center, extent, w.timestep, data_floats(w, DATA.geom_xmat, (size(w, MODEL.ngeom), 9))
    return leave_fast(contacts_at(w), geometry_of(w), motion, _carriers(w), chosen, doubtful)


@plain
def look_ahead(w, jacobian, middle, chosen, seen, doubtful):
    """Take contacts out of those that are seen if bodies pass them, see `pass_over`."""
    ngeom, qvel = size(w, MODEL.ngeom), velocity_of(w)
    extent = model_floats(w, MODEL.geom_aabb, (ngeom, 6))
    qpos = floats(long_at(w.scratch + offset(w, DATA.qpos)), len(middle))
    at = w.model, w.scratch, address_of(qpos), address_of(qvel)
    place = qpos, *_mocap(w, w.scratch)
    found, geometry, carriers = contacts_at(w), geometry_of(w), _carriers(w)
    pass_over(found, geometry, extent, carriers, jacobian, qvel, w.timestep, middle, place, at, chosen, seen, doubtful)
