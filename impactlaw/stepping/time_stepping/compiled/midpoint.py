"""A compiled step before its contact problem: the midpoint, and the velocity due to forces alone."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import clear, equal, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    data_floats,
    number,
    offset,
    option,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import DATA, MODEL, address_of, flags, floats, int_at, ints, put_int
from impactlaw.stepping.time_stepping.compiled.detection.contact_points import mend
from impactlaw.stepping.time_stepping.compiled.detection.far_contacts import far_ones_close, leave_far_out
from impactlaw.stepping.time_stepping.compiled.detection.nearest_points import find_nearest
from impactlaw.stepping.time_stepping.compiled.detection.standing_cylinders import find_standing
from impactlaw.stepping.time_stepping.compiled.end_of_step import update_frames
from impactlaw.stepping.time_stepping.compiled.impulses.forces import settle
from impactlaw.stepping.time_stepping.compiled.limits import hide_far_limits, narrow_limits
from impactlaw.stepping.time_stepping.compiled.margins import narrow, outruns, write_margins
from impactlaw.stepping.time_stepping.compiled.model_copy import (
    keep_margins,
    scale_margins,
    widen_limits,
    widen_margins,
)
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, MARKS, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY, are_left, forget
from impactlaw.stepping.time_stepping.compiled.state.surfaces import begin_surfaces, place_surfaces, speeds_of_middle
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.tolerances import ALWAYS, SHARES

_EULER, _CONSTRAINT = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
_EXACT = int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
_CONTACT_FULL, _ROWS_FULL = int(mujoco.mjtWarning.mjWARN_CONTACTFULL), int(mujoco.mjtWarning.mjWARN_CNSTRFULL)


@plain
def begin(w, counts, left, frames, gained, held, loaded):
    """Make data current, and forget results that are not those of the last step."""
    nq = size(w, MODEL.nq)
    qpos, qvel = data_floats(w, DATA.qpos, nq), velocity_of(w)
    same = counts[MEMORY.known] != 0 and equal(left[:nq], qpos) and equal(left[nq:], qvel)
    if loaded or not same or not are_left(w, frames):
        update_frames(w)
    counts[MEMORY.known] = same
    if not same:
        forget(counts)
        clear(gained)
        clear(held)


@plain
def _prepare_margins(w, gained, work):
    """Set margins such that MuJoCo finds the contacts that bodies can reach in this step; see `margins.write_margins`.

    ``work``, (6 nbody + max(nv, 5 nbody),), is scratch space.
    """
    nbody = size(w, MODEL.nbody)
    qvel, moving, kept = velocity_of(w), data_floats(w, DATA.cvel, 6 * nbody), work[6 * nbody :]
    now = floats(address_of(work), (nbody, 6))
    put(work, moving)
    put(kept, qvel)
    for i in range(w.nv):
        qvel[i] += gained[i]
    mj.com_vel(w.model, w.data)
    put(qvel, kept[: w.nv])
    write_margins(w, now, data_floats(w, DATA.cvel, (nbody, 6)), work[6 * nbody :])


@plain
def _find_contacts(w, now):
    """Do what `_find` does, with smaller margins if MuJoCo has no room for all contacts; return whether it has none."""
    warnings = ints(w.data + offset(w, DATA.warning), 2 * (max(_CONTACT_FULL, _ROWS_FULL) + 1))
    for share in (*SHARES, 1.0):
        seen = warnings[2 * _CONTACT_FULL + 1] + warnings[2 * _ROWS_FULL + 1]
        _find(w, now)
        full = warnings[2 * _CONTACT_FULL + 1] + warnings[2 * _ROWS_FULL + 1] != seen
        if full:
            scale_margins(w, share)
        if not narrow(w, share) and not full:
            return False
    return True


@plain
def _find(w, now):
    """Compute everything that depends on positions; rows of constraints are made after contacts have been mended.

    Contacts that are too far away to close at velocities of bodies, ``now`` or those of data, get no rows, unless
    ``now`` is empty.

    Flexes keep results in the memory that a second detection frees, and the transmission of adhesion reads rows: there,
    rows are made twice.
    """
    at = w.model + offset(w, MODEL.opt_disableflags)
    flags, twice = int_at(at), size(w, MODEL.nflex) > 0 or setting(w, SETTING.sticks) != 0.0
    if not twice:
        put_int(at, np.int32(flags | _CONSTRAINT))
    mj.fwd_position(w.model, w.data)
    put_int(at, flags)
    mended = find_standing(w, twice)
    mended = _mend_contacts(w, now[:0] if twice else now) or mended
    if mended or not twice:
        _make_rows(w)


@plain
def _make_rows(w):
    """Make the rows of constraints, with exact diagonals of ``J M^-1 J^T`` if the user has chosen them."""
    mj.make_constraint(w.model, w.data)
    if option(w, MODEL.opt_enableflags) & _EXACT:
        mj.project_constraint(w.model, w.data)


@plain
def _mend_contacts(w, now):
    """Correct contacts, see `contact_points.mend`, and leave out those that are too far away; return whether any is.

    These are contacts that cannot close at velocities of bodies, ``now``, (nbody, 6), or those of data; none if it is
    empty.
    """
    mended = False
    if number(w, DATA.ncon) > 0:
        nearer = find_nearest(w)
        mended = mend(w) or nearer
    return (len(now) > 0 and leave_far_out(w, now)) or mended


@linked(BOOLEAN(WORLD, *[NUMBERS] * 4), counts=False)
def to_midpoint(w, gained, start, middle, work):
    """Move bodies to the middle of the step, find contacts there, and compute what depends on the velocity.

    Only limits that joints can reach are looked for.

    Args:
        w: the world at the start of the step.
        gained: change of velocity by forces in the last step, (nv,).
        start: velocity at the start, (nv,), written.
        middle: position in the middle of the step, (nq,), written.
        work: scratch space, (6 nbody + max(nv, 5 nbody),).

    Returns:
        Whether MuJoCo had no room for all contacts.
    """
    if w.surfaces != 0:
        begin_surfaces(w)
    _prepare_margins(w, gained, work)
    narrow_limits(w, gained)
    put(start, velocity_of(w))
    if w.surfaces != 0:
        place_surfaces(w)
    qpos, sensors = data_floats(w, DATA.qpos, size(w, MODEL.nq)), size(w, MODEL.nsensordata) > 0
    mj.integrate_pos(w.model, address_of(qpos), address_of(start), 0.5 * w.timestep)
    put(middle, qpos)
    full = _find_contacts(w, floats(address_of(work), (size(w, MODEL.nbody), 6)))
    if sensors:
        # otherwise MuJoCo would reuse results of the last step
        for field in (DATA.flg_subtreevel, DATA.flg_rnepost, DATA.flg_energypos, DATA.flg_energyvel):
            flags(w.data + offset(w, field), 1)[0] = 0
        hide_far_limits(w)
        mj.sensor_pos(w.model, w.data)
        hide_far_limits(w)
    mj.fwd_velocity(w.model, w.data)
    if sensors:
        hide_far_limits(w)
        mj.sensor_vel(w.model, w.data)
        hide_far_limits(w)
    return full


@linked(types.void(WORLD, *[NUMBERS] * 3, MARKS, *[NUMBERS] * 3), counts=False)
def free_step(w, start, held, bias, turning, gravity, gained, work):
    """Advance velocity, activations and time by MuJoCo's integrator without contact.

    ``gained``, (nv,), is the change of velocity, written; for the other arguments see `impulses.forces.settle`.
    """
    nv = w.nv
    mj.fwd_actuation(w.model, w.data)
    mj.fwd_acceleration(w.model, w.data)
    put(data_floats(w, DATA.qacc, nv), data_floats(w, DATA.qacc_smooth, nv))
    clear(data_floats(w, DATA.qfrc_constraint, nv))
    if option(w, MODEL.opt_integrator) == _EULER:
        mj.euler(w.model, w.data)
    else:
        mj.implicit(w.model, w.data)
    qvel = velocity_of(w)
    if setting(w, SETTING.inertial) != 0.0:
        settle(w, start, held, bias, turning, gravity, work)
    for i in range(nv):
        gained[i] = qvel[i] - start[i]
    if w.surfaces != 0:
        speeds_of_middle(w)


@linked(BOOLEAN(WORLD, *[NUMBERS] * 3), counts=False)
def detect_limits(w, start, free, middle):
    """Find all limits in addition to the contacts found, with data as it was without contact.

    Return whether MuJoCo had no room for all rows.
    """
    qvel, warnings = velocity_of(w), ints(w.data + offset(w, DATA.warning), 2 * (_ROWS_FULL + 1))
    put(data_floats(w, DATA.qpos, len(middle)), middle)
    put(qvel, start)
    mj.com_vel(w.model, w.data)  # constraint targets depend on it, and `settle` has left that of another velocity
    widen_limits(w, ALWAYS)
    seen = warnings[2 * _ROWS_FULL + 1]
    _make_rows(w)
    mj.reference_constraint(w.model, w.data)
    put(qvel, free)
    return warnings[2 * _ROWS_FULL + 1] != seen


@linked(BOOLEAN(WORLD, *[NUMBERS] * 4), counts=False)
def detect_farther(w, start, free, middle, work):
    """Find the contacts that bodies can reach after a collision, with data as it was without contact.

    All contacts that were found before are found again, even if they are now out of reach: they may have caused the
    collision. Return whether MuJoCo had no room for all contacts.

    Args:
        w: the world; the velocities of bodies are those after the collision.
        start: velocity at the start, (nv,).
        free: velocity without contact, (nv,).
        middle: position in the middle of the step, (nq,).
        work: scratch space for 11 nbody numbers and the margins.
    """
    nbody, qvel = size(w, MODEL.nbody), velocity_of(w)
    before = work[11 * nbody :]
    keep_margins(w, before)
    led_to = floats(address_of(work), (nbody, 6))
    put(work, data_floats(w, DATA.cvel, 6 * nbody))
    put(data_floats(w, DATA.qpos, len(middle)), middle)
    put(qvel, start)
    mj.com_vel(w.model, w.data)
    write_margins(w, data_floats(w, DATA.cvel, (nbody, 6)), led_to, work[6 * nbody :])
    widen_margins(w, before)
    full = _find_contacts(w, led_to[:0])
    mj.fwd_velocity(w.model, w.data)
    put(qvel, free)
    return full


@linked(BOOLEAN(WORLD, NUMBERS), counts=False)
def outrun(w, work):
    """Return whether a collision throws a body farther than contacts were looked for.

    The velocities of bodies must be those after the collision, as `find_impulses` leaves them. ``work``, (2 nbody,), is
    scratch space.
    """
    return far_ones_close(w) or outruns(w, work)
