"""Contacts of cylinders that stand on planes, in compiled code; see `problem.detection.standing_cylinders`."""

from __future__ import annotations

from impactlaw.linked import linked
from impactlaw.scene.corrected.rounding import measure_standing
from impactlaw.solvers.cones.algebra.loops import numbers, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contacts_of,
    data_floats,
    model_floats,
    model_ints,
    number,
    offset,
    shapes_of,
    size,
)
from impactlaw.stepping.compiled.fields import DATA, MODEL, floats, keep
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, WORLD
from impactlaw.stepping.time_stepping.compiled.state.surfaces import ROW, velocities_of
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.detection.standing_cylinders import make_upright


@linked(BOOLEAN(WORLD, BOOLEAN))
def find_standing(w, found):
    """Find contacts, and measure the gaps of cylinders that stand on planes again; return whether any has changed.

    Args:
        w: the world with current frames of geoms.
        found: whether MuJoCo has found the contacts of this state already.
    """
    if setting(w, SETTING.stands) == 0.0:
        if not found:
            mj.collision(w.model, w.data)
        return False
    nbody, ngeom, (kind, sizes, place, turn) = size(w, MODEL.nbody), size(w, MODEL.ngeom), shapes_of(w)
    motion = (
        data_floats(w, DATA.cvel, (nbody, 6)), data_floats(w, DATA.subtree_com, (nbody, 3)),
        model_ints(w, MODEL.body_rootid, nbody), model_ints(w, MODEL.geom_bodyid, ngeom),
        floats(w.model + offset(w, MODEL.opt_gravity), 3), model_ints(w, MODEL.body_mocapid, nbody),
        data_floats(w, DATA.mocap_pos, (size(w, MODEL.nmocap), 3)), velocities_of(w, ROW.end),
    )  # fmt: skip
    margins = model_floats(w, MODEL.geom_margin, ngeom), model_floats(w, MODEL.pair_margin, size(w, MODEL.npair))
    room = numbers(9 * ngeom)
    changed = make_upright(kind, sizes, place, turn, margins, motion, room.reshape((ngeom, 9)))
    if changed or not found:
        mj.collision(w.model, w.data)
    if changed:
        put(data_floats(w, DATA.geom_xmat, 9 * ngeom), room)
    if number(w, DATA.ncon) > 0:
        dist, pos, frame, geom = contacts_of(w)
        changed = measure_standing(kind, sizes, place, turn, geom, dist, pos, frame) or changed
    keep(room)
    return changed
