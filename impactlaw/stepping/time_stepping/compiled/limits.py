"""Limits of joints in a compiled step: only rows that joints can reach, or all if that was not enough.

MuJoCo computes a row for each limit within the joint's margin, and most limits are far away. If a limit that was left
out would be passed after all, since contact can throw a link, impulses are found again with all limits.
"""

from __future__ import annotations

import mujoco

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.compiled.access import (
    model_at,
    model_floats,
    model_ints,
    row_floats,
    row_ints,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import DATA, MODEL, flags
from impactlaw.stepping.time_stepping.problem.forces import hide_limits
from impactlaw.stepping.time_stepping.tolerances import LEAST

_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)


@plain
def hide_far_limits(w):
    """Hide limits that are far away from MuJoCo's sensors, or show them again; see `forces.hide_limits`."""
    rows = row_ints(w, DATA.efc_type), row_ints(w, DATA.efc_id), row_floats(w, DATA.efc_pos)
    hide_limits(*rows, row_floats(w, DATA.efc_margin))


@plain
def narrow_limits(w, gained):
    """Set margins to find the limits that joints can reach in two steps.

    Forces may add twice the velocity that they added in the last step, (nv,).
    """
    joints, qvel = size(w, MODEL.njnt), velocity_of(w)
    kind, dof = model_ints(w, MODEL.jnt_type, joints), model_ints(w, MODEL.jnt_dofadr, joints)
    margin = model_floats(w, MODEL.jnt_margin, joints)
    for j in range(joints):
        if kind[j] == _SLIDE or kind[j] == _HINGE:
            speed, more = qvel[dof[j]], gained[dof[j]]
            margin[j] = 2.0 * w.timestep * (max(abs(speed), abs(speed + more)) + abs(more)) + LEAST


@plain
def passes_limit(w, middle, reach, shift, opens):
    """Return whether velocities lead past a limit that was not found, within a time, s, from the midpoint, (nq,).

    If a step `opens` overlaps, joints also move by ``shift``, (nv,), during a timestep. Limits count that the velocity
    alone leads past, too: with their rows, they would take part.
    """
    joints, qvel = size(w, MODEL.njnt), velocity_of(w)
    kind, dof = model_ints(w, MODEL.jnt_type, joints), model_ints(w, MODEL.jnt_dofadr, joints)
    place, margin = model_ints(w, MODEL.jnt_qposadr, joints), model_floats(w, MODEL.jnt_margin, joints)
    limited, ends = flags(model_at(w, MODEL.jnt_limited), joints), model_floats(w, MODEL.jnt_range, 2 * joints)
    for j in range(joints):
        if limited[j] == 0 or (kind[j] != _SLIDE and kind[j] != _HINGE):
            continue
        now, moved, more = middle[place[j]], reach * qvel[dof[j]], w.timestep * shift[dof[j]] if opens else 0.0
        lower, upper, down, up = now - ends[2 * j], ends[2 * j + 1] - now, min(0.0, more), max(0.0, more)
        if (lower >= margin[j] and lower + moved + down < 0.0) or (upper >= margin[j] and upper - moved - up < 0.0):
            return True
    return False
