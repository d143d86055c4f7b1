"""The end of a compiled step: outputs of contact and sensors in its middle, then the state at its end."""

from __future__ import annotations

import mujoco
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import copied, kernel, norm, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import data_floats, option, size, velocity_of
from impactlaw.stepping.compiled.fields import DATA, MODEL, address_of
from impactlaw.stepping.time_stepping.compiled.end_of_step import (
    copy_contacts,
    correct_end,
    limit_energy,
    update_frames,
    update_inertia,
    write_forces,
)
from impactlaw.stepping.time_stepping.compiled.limits import hide_far_limits
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, INTEGER, MARKS, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.status import FINE, HUGE_OUTPUT
from impactlaw.stepping.time_stepping.compiled.state.surfaces import aim_surfaces, end_surfaces
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.rows import ROWS
from impactlaw.stepping.time_stepping.tolerances import HUGE

_POS, _VEL = int(mujoco.mjtStage.mjSTAGE_POS), int(mujoco.mjtStage.mjSTAGE_VEL)
_ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)


@kernel
def _sense(w, start):
    """Compute the sensors that depend on accelerations and forces, at the middle of the step.

    Those that depend on the list of contacts are computed again, since it is shorter now (`forces.listed_stage`).
    """
    qvel, listed = velocity_of(w), setting(w, SETTING.listed)
    after = copied(qvel)
    put(qvel, start)
    mj.com_vel(w.model, w.data)
    hide_far_limits(w)
    if listed >= _POS:
        mj.sensor_pos(w.model, w.data)
    if listed >= _VEL:
        mj.sensor_vel(w.model, w.data)
    mj.sensor_acc(w.model, w.data)
    hide_far_limits(w)
    put(qvel, after)


@plain
def _move_to_end(w, start, middle, shift, opens):
    """Move data to the end of the step and update frames; return `status.FINE`, or that data is huge."""
    qpos, qvel = data_floats(w, DATA.qpos, len(middle)), velocity_of(w)
    put(qpos, middle)
    if size(w, MODEL.nsensordata) > 0:
        _sense(w, start)
    mj.integrate_pos(w.model, address_of(qpos), address_of(qvel), 0.5 * w.timestep)
    if opens:
        mj.integrate_pos(w.model, address_of(qpos), address_of(shift), w.timestep)
    if not (norm(qpos) <= HUGE and norm(qvel) <= HUGE):
        return HUGE_OUTPUT
    if w.surfaces != 0:
        aim_surfaces(w)
    update_frames(w)
    return FINE


@linked(
    types.Tuple((INTEGER, BOOLEAN))(
        WORLD, ROWS, *[NUMBERS] * 4, BOOLEAN, BOOLEAN, types.int32, NUMBERS, types.int32[::1], NUMBERS
    ),
    counts=False,
)  # fmt: skip
def end_step(w, rows, x, start, middle, shift, opens, met, cone, force, pairs, gaps):
    """Write the forces of contact, move data to the end of the step, and open overlaps that are new there.

    Args:
        w: the world in the middle of the step, with the velocity at the end.
        rows: the rows of the step.
        x: their impulses, in units of the problem, (n,).
        start: velocity at the start, (nv,).
        middle: position in the middle of the step, (nq,).
        shift: velocity that opens overlaps, (nv,).
        opens: whether there are any to open.
        met: whether the law is met: overlaps that are squeezed cannot be opened.
        cone: kind of friction cone that the user has chosen.
        force: scratch space, (nefc,).
        pairs: geoms of contacts, see `copy_contacts`, written, like the next one.
        gaps: gaps of contacts.

    Returns:
        `status.FINE`, or that data is huge, and whether new overlaps remain.
    """
    put(data_floats(w, DATA.qpos, len(middle)), middle)  # the integrator changed it: limits need the midpoint
    copy_contacts(w, pairs, gaps)  # MuJoCo's list of contacts becomes shorter
    write_forces(w, rows, x, start, cone, force)
    status = _move_to_end(w, start, middle, shift, opens)
    return status, status == FINE and met and correct_end(w, rows, pairs, gaps)


@linked(types.void(WORLD, NUMBERS, NUMBERS, MARKS, NUMBERS), counts=False)
def finish(w, begun, start, turning, gravity):
    """Limit energies, and write the remaining outputs of a step beside the state.

    Args:
        w: the world at the end of the step.
        begun: position at the start, (nq,).
        start: velocity at the start, (nv,).
        turning: trees of bodies that turn too fast, bool (ntree,).
        gravity: force of gravity in the middle of the step, (nv,), if there are such trees.
    """
    if setting(w, SETTING.inertial) != 0.0 and turning.any():
        limit_energy(w, begun, start, turning, gravity)
    if option(w, MODEL.opt_enableflags) & _ENERGY:
        update_inertia(w)
        mj.energy_pos(w.model, w.data)
        mj.energy_vel(w.model, w.data)
    put(data_floats(w, DATA.qacc_warmstart, w.nv), data_floats(w, DATA.qacc, w.nv))
    if w.surfaces != 0:
        end_surfaces(w)
