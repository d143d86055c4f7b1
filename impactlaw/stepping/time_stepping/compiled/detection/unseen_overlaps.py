"""Overlaps at the start of a step whose contact the last step has not seen."""

from __future__ import annotations

import mujoco
from numba import types

from impactlaw.linked import linked
from impactlaw.scene.tolerances import APART
from impactlaw.solvers.cones.algebra.loops import put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import model_ints, offset, size
from impactlaw.stepping.compiled.fields import DATA, MODEL, floats, long_at
from impactlaw.stepping.time_stepping.compiled.detection.carriers import carrier_of
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.problem.overlaps import COUNTED
from impactlaw.stepping.time_stepping.problem.rows import ROWS, find_group

_SDF = int(mujoco.mjtGeom.mjGEOM_SDF)


@linked(BOOLEAN(WORLD, ROWS, types.int64[::1], NUMBERS), counts=False)
def begins_overlapping(w, rows, known_key, start):
    """Return whether bodies overlap at the start of a step whose contact the last step has not seen.

    MuJoCo finds no contact of some boxes that are still apart. Gradients tell which overlaps are possible, and these
    are measured in other data. Bodies that mocap bodies carry are left out.

    Args:
        w: the world.
        rows: the rows of the step.
        known_key: keys of the groups of the last step.
        start: position at the start, (nq,).
    """
    shape, placed = model_ints(w, MODEL.geom_type, size(w, MODEL.ngeom)), False
    for g in range(len(rows.key)):
        row, one, other = rows.groups[0, g], rows.key[g] >> 32, rows.key[g] & 0xFFFFFFFF
        if rows.groups[3, g] < 0 or rows.amounts[0, g] - 0.5 * w.timestep * rows.rates[1, row] >= -COUNTED:
            continue
        known = find_group(rows.key[g], known_key, 0) >= 0 or shape[one] == _SDF or shape[other] == _SDF
        if known or carrier_of(w, one) >= 0 or carrier_of(w, other) >= 0:
            continue
        if not placed:
            put(floats(long_at(w.scratch + offset(w, DATA.qpos)), len(start)), start)
            mj.kinematics(w.model, w.scratch)
            placed = True
        if mj.geom_distance(w.model, w.scratch, one, other, APART, 0) < -COUNTED:
            return True
    return False
