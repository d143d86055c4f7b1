"""One step of `scheme.SoftStepping` in compiled code, by MuJoCo's C functions; the reasons are given there."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import FLOATS, clear, copied, kernel, norm, numbers, once, plain, put, zeros
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contact_ints,
    data_at,
    data_floats,
    number,
    offset,
    option,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import (
    CONTACT,
    DATA,
    MODEL,
    address_of,
    float_at,
    int_at,
    ints,
    keep,
    long_at,
    put_int,
)
from impactlaw.stepping.integration import STEP_STATE
from impactlaw.stepping.soft.compiled.collide import SHORT, collide
from impactlaw.stepping.soft.compiled.contacts.active_contacts import find, normal_velocities
from impactlaw.stepping.soft.compiled.contacts.kinds import LAW
from impactlaw.stepping.soft.compiled.contacts.position_correction import put_back
from impactlaw.stepping.soft.compiled.contacts.rebounds import bounces, hold_back
from impactlaw.stepping.soft.compiled.locked_joints import lock, locks, room, takes_forces, unlock
from impactlaw.stepping.soft.compiled.without_new_contacts import (
    advance_without_new_contacts,
    find_contact_forces,
    is_plain,
    keep_start,
    meets_more,
    passes_limit,
    row_numbers,
    start_room,
)
from impactlaw.stepping.soft.compiled.world import DIVERGED, FINE, PYTHON, Start, World

_RK4, _EULER, _DISCRETE = (int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}")) for name in ("RK4", "EULER", "DISCRETE"))
_POSITION, _VELOCITY = int(mujoco.mjtStage.mjSTAGE_POS), int(mujoco.mjtStage.mjSTAGE_VEL)
_COMPARE, _ENERGY = int(mujoco.mjtEnableBit.mjENBL_FWDINV), int(mujoco.mjtEnableBit.mjENBL_ENERGY)
_BAD_POSITION, _BAD_VELOCITY, _BAD_ACCELERATION = (
    int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{name}")) for name in ("QPOS", "QVEL", "QACC")
)
_HUGE = mujoco.mjMAXVAL


@plain
def _bad_states(w):
    """Return how often MuJoCo has met a state that is not finite, or huge."""
    warnings = ints(w.data + offset(w, DATA.warning), 2 * (max(_BAD_POSITION, _BAD_VELOCITY, _BAD_ACCELERATION) + 1))
    return warnings[2 * _BAD_POSITION + 1] + warnings[2 * _BAD_VELOCITY + 1] + warnings[2 * _BAD_ACCELERATION + 1]


@plain
def _touches(w):
    return number(w, DATA.ncon) + number(w, DATA.nl)


@kernel
def _collide(w, law, start, sums):
    """Resolve the current collisions, if there are any; see `collide.collide`."""
    qpos = data_floats(w, DATA.qpos, size(w, MODEL.nq))
    if _touches(w) == 0 or not (norm(qpos) <= _HUGE and norm(velocity_of(w)) <= _HUGE):
        return FINE, False
    return collide(w, law, start, sums)


@plain
def _update(w):
    """Do what `mj_forward` does, except for sensors and energies."""
    mj.fwd_position(w.model, w.data)
    _update_forces(w)


@plain
def _update_forces(w):
    """Do the part of `_update` that depends on velocities."""
    mj.fwd_velocity(w.model, w.data)
    mj.fwd_actuation(w.model, w.data)
    mj.fwd_acceleration(w.model, w.data)
    mj.fwd_constraint(w.model, w.data)


@plain
def _update_velocity(w):
    """Do the part of `mj_forward` that depends on velocities, but not on forces."""
    mj.fwd_velocity(w.model, w.data)
    mj.sensor_vel(w.model, w.data)
    if option(w, MODEL.opt_enableflags) & _ENERGY:
        mj.energy_vel(w.model, w.data)


@plain
def _runge_kutta(w):
    """Do what `stages._runge_kutta` does."""
    place = w.data + offset(w, DATA.maxuse_efc)
    so_far = int_at(place)
    put_int(place, np.int32(0))
    mj.runge_kutta(w.model, w.data, np.int32(4))
    most = int_at(place)
    put_int(place, max(so_far, most))
    return most


@kernel
def _velocity_in(w, state):
    """Return qvel in a state, (nv,)."""
    q = 1 + size(w, MODEL.nq)
    return state[q : q + w.nv]


@kernel
def _closes(w, law, velocity):
    """Return whether a current contact would close faster than `rest_speed` with another velocity, (nv,)."""
    rows, found = numbers(number(w, DATA.nefc)), find(w, law.bilateral)
    mj.mul_jac_vec(w.model, w.data, address_of(rows), address_of(velocity))
    keep(rows)
    return normal_velocities(found, rows, numbers(len(found.row))) < -law.rest_speed


@plain
def _go_to_start(now, state, start):
    """Put other data where `keep_start` was called."""
    mj.set_state(now.model, now.data, address_of(state), STEP_STATE)
    if is_plain(now):
        keep_start(now, start, True)
    else:
        _update(now)


@kernel
def _will_meet_more(w, trial, state, start, geoms, rows):
    """Return the result of `stages._will_meet_more`."""
    now, velocity = World(w.model, trial, w.table, w.nv), numbers(w.nv)
    _go_to_start(now, state, start)
    h, qvel = float_at(w.model + offset(w, MODEL.opt_timestep)), velocity_of(now)
    acceleration = data_floats(now, DATA.qacc, w.nv)
    for i in range(w.nv):
        velocity[i] = qvel[i] + 0.5 * h * acceleration[i]
    mj.integrate_pos(w.model, data_at(now, DATA.qpos), address_of(velocity), h)
    keep(velocity)
    mj.fwd_position(w.model, trial)
    return meets_more(now, geoms, rows)


@kernel
def _collide_at_end(w, law, other, pushing, state, start, geoms, sums):
    """Take an RK4 step without new contacts; keep it if it ends in a collision that the law changes.

    It is taken in other data, or in that of the world, if `other` is the same, which must then be at the start. Return
    the status, and whether the step is kept; if not, data is as before.
    """
    now, here = World(w.model, other, w.table, w.nv), other == w.data
    if not here:
        _go_to_start(now, state, start)
    advance_without_new_contacts(now, pushing)
    mj.fwd_position(w.model, other)
    mj.fwd_velocity(w.model, other)
    of_trial, told, before = zeros(len(sums)), copied(law.outcomes[:1]), numbers(w.nv)
    put(before, velocity_of(now))
    status, changed = _collide(now, law, Start(0, state, geoms), of_trial)
    if status == FINE and not changed:
        put(law.outcomes, told)
        sums[SHORT] += of_trial[SHORT]
    if status == FINE and changed:
        sums += of_trial
        put_back(now, law, before)
        if not here:
            end = numbers(len(state))
            mj.get_state(w.model, other, address_of(end), STEP_STATE)
            mj.set_state(w.model, w.data, address_of(end), STEP_STATE)
            keep(end)
            mj.fwd_position(w.model, w.data)
        _update_forces(w)
        if option(w, MODEL.opt_enableflags) & _ENERGY:
            mj.energy_pos(w.model, w.data)
            mj.energy_vel(w.model, w.data)
    elif here:
        _go_to_start(w, state, start)
    return status, changed


@once
def _from_start(w, law, trial, integrator, state, sums):
    """Do what `mj_step` does, but apply the law before forces are computed."""
    mj.first_half(w.model, w.data)
    locked = _touches(w) > 0 and locks(w)
    kept = numbers(room(w) if locked else 0)
    if locked:
        lock(w, kept)
    status, changed = _collide(w, law, Start(trial, state, np.zeros((0, 2), np.int32)), sums)
    if locked and (changed or status != FINE or not takes_forces(w)):
        unlock(w, kept)
    if status != FINE:
        return status
    if changed and put_back(w, law, _velocity_in(w, state)):
        mj.sensor_pos(w.model, w.data)
        if option(w, MODEL.opt_enableflags) & _ENERGY:
            mj.energy_pos(w.model, w.data)
    if locked and takes_forces(w) and _touches(w) > 0:
        if changed:
            _update_velocity(w)  # with M: its energy
            lock(w, kept)
        mj.rest_of_forward(w.model, w.data, np.int32(_VELOCITY), np.int32(0))
    else:
        locked = False
        mj.rest_of_forward(w.model, w.data, np.int32(_POSITION if changed else _VELOCITY), np.int32(0))
    held = bounces(w) and hold_back(w, law)
    if held:
        mj.rest_of_forward(w.model, w.data, np.int32(_VELOCITY), np.int32(0))
    if locked:
        unlock(w, kept)
    mj.check_acc(w.model, w.data)
    if option(w, MODEL.opt_enableflags) & _COMPARE:
        mj.compare_fwd_inv(w.model, w.data)
    if integrator == _RK4 and not held:  # its stages would compute forces of their own
        middle, start, pushing = copied(state), numbers(start_room(w)), zeros(w.nv if _touches(w) > 0 else 0)
        if len(pushing) > 0:
            find_contact_forces(w, pushing)
        keep_start(w, start, False)
        geoms = contact_ints(w, CONTACT.geom, 2).copy()
        if changed:
            mj.get_state(w.model, w.data, address_of(middle), STEP_STATE)
        if passes_limit(w):
            other = w.data if is_plain(w) else trial
            status, collided = _collide_at_end(w, law, other, pushing, middle, start, geoms, sums)
            if status == FINE and not collided:
                mj.runge_kutta(w.model, w.data, np.int32(4))
        else:
            rows = row_numbers(w)
            most = _runge_kutta(w)
            between = most > number(w, DATA.nefc)
            if between and most <= len(rows):
                between = _will_meet_more(w, trial, middle, start, geoms, rows)
            same = np.array_equal(row_numbers(w), rows) and np.array_equal(contact_ints(w, CONTACT.geom, 2), geoms)
            if between or (not same and _closes(w, law, _velocity_in(w, middle))):
                status, collided = _collide_at_end(w, law, trial, pushing, middle, start, geoms, sums)
        keep(middle)
    elif integrator == _EULER or integrator == _RK4:
        mj.euler(w.model, w.data)
    else:
        mj.implicit(w.model, w.data)
    return status


@linked(types.int64(*[types.int64] * 4, LAW, FLOATS, FLOATS, types.boolean))
def advance(model, data, trial, table, law, state, sums, collides):
    """Take one step and return its status, see `world`; unless that is `FINE` or `DIVERGED`, data is as it was before.

    Args:
        model: address of the model.
        data: address of its data.
        trial: address of other data.
        table: address of offsets of fields, see `compiled.fields`.
        law: see `world.Law`.
        state: the state at the start of the step, written.
        sums: sums over the collisions, see `collide`, written.
        collides: whether the scene can have collisions.
    """
    nv = long_at(model + long_at(table + 8 * MODEL.nv))
    w = World(model, data, table, nv)
    time_at = data + offset(w, DATA.time)
    time, integrator = float_at(time_at), option(w, MODEL.opt_integrator)
    timestep = float_at(model + offset(w, MODEL.opt_timestep))
    if integrator == _DISCRETE or not 0.0 < timestep < np.inf:
        return PYTHON
    clear(sums)
    clear(law.outcomes[:1])
    bad = _bad_states(w)
    mj.get_state(model, data, address_of(state), STEP_STATE)
    status = FINE
    if not collides:
        mj.whole_step(model, data)
    else:
        status = _from_start(w, law, trial, integrator, state, sums)
    if status != FINE:
        mj.set_state(model, data, address_of(state), STEP_STATE)
        return status
    if float_at(time_at) <= time or _bad_states(w) != bad:
        return DIVERGED
    return FINE
