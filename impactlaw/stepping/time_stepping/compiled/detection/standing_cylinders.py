"""Contacts of cylinders that stand or rock on flat faces, with the geometry of `scene.corrected.standing`."""

from __future__ import annotations

import mujoco

from impactlaw.linked import linked
from impactlaw.scene.corrected.rounding import align
from impactlaw.scene.corrected.standing import find_corners
from impactlaw.solvers.cones.algebra.loops import kernel, numbers, plain, put, zeros
from impactlaw.solvers.cones.algebra.vectors import row
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_floats,
    contact_ints,
    contacts_of,
    data_floats,
    model_ints,
    offset,
    shapes_of,
    size,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, floats, keep
from impactlaw.stepping.time_stepping.compiled.detection.carriers import carried, carrier_of
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, WORLD
from impactlaw.stepping.time_stepping.compiled.state.surfaces import ROW, velocities_of
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting

PLANE, CYLINDER = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_FLAT = 1e-7  # m: height of a rim above its middle up to which the whole rim is closed
_BEYOND = 1
"""MuJoCo's mark of contacts beyond their margins; it has others for other reasons."""


@linked(BOOLEAN(WORLD, BOOLEAN))
def find_standing(w, found):
    """Find contacts, also those of cylinders that are upright on planes up to rounding, which MuJoCo can miss.

    Args:
        w: the world with current frames of geoms.
        found: whether MuJoCo has found the contacts of this state already.

    Returns:
        Whether any contact can have changed since then.
    """
    aligns = setting(w, SETTING.stands) != 0.0
    if found and not aligns:
        return False
    kept, (kind, _, _, turn) = numbers(9 * size(w, MODEL.ngeom) if aligns else 0), shapes_of(w)
    put(kept, data_floats(w, DATA.geom_xmat, len(kept)))
    turned = aligns and align(kind, turn)
    if turned or not found:
        mj.collision(w.model, w.data)
    put(data_floats(w, DATA.geom_xmat, len(kept)), kept)
    keep(kept)
    return found and turned


@kernel
def gravity_of(w):
    """Return the acceleration of gravity, m/s^2, (3,)."""
    return floats(w.model + offset(w, MODEL.opt_gravity), 3)


@plain
def _write_motion(w, motion):
    """Add what mocap bodies carry: velocities of second geoms of contacts beside the first ones; see `find_corners`."""
    (_, pos, _, geom), velocity = contacts_of(w), velocities_of(w, ROW.end)
    for k in range(len(geom) if len(velocity) > 0 else 0):
        for side in range(2):
            body, sign = carrier_of(w, geom[k, side]), 2.0 * side - 1.0
            moved = carried(w, body, row(pos, k), ROW.end)
            for i in range(3 if body >= 0 else 0):
                motion[k, i] += sign * velocity[body, 3 + i]
            motion[k, 3] += sign * moved[0]
            motion[k, 4] += sign * moved[1]
            motion[k, 5] += sign * moved[2]


@kernel
def corners_of(w, owner, added):
    """Put contacts of ends on faces at their corners, and list others; see `find_corners`, also for what it returns."""
    (dist, pos, frame, geom), n = contacts_of(w), size(w, MODEL.nbody)
    motion = zeros(6 * len(geom)).reshape((len(geom), 6))
    _write_motion(w, motion)
    bodies = (
        model_ints(w, MODEL.geom_bodyid, size(w, MODEL.ngeom)),
        model_ints(w, MODEL.body_rootid, n),
        data_floats(w, DATA.cvel, (n, 6)),
        data_floats(w, DATA.subtree_com, (n, 3)),
    )
    reach = contact_floats(w, CONTACT.includemargin, 1)[:, 0]
    return find_corners(shapes_of(w), bodies, geom, reach, dist, pos, frame, motion, gravity_of(w), _FLAT, owner, added)


@plain
def leave_open_out(w):
    """Mark contacts beyond their margins, of which MuJoCo then makes no rows."""
    dist, exclude = contacts_of(w)[0], contact_ints(w, CONTACT.exclude, 1)
    reach = contact_floats(w, CONTACT.includemargin, 1)[:, 0]
    for k in range(len(dist)):
        if exclude[k, 0] <= _BEYOND:
            exclude[k, 0] = _BEYOND if dist[k] >= reach[k] else 0
