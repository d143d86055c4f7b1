"""One step of `scheme.TimeStepping` in compiled code, over MuJoCo's C functions; see there what each part is for."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import compiled
from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import copied, kernel, norm, numbers, once, plain, zeros
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    data_floats,
    model_floats,
    model_ints,
    nonzeros_of,
    number,
    offset,
    option,
    rows_of,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import (
    DATA,
    MODEL,
    address_of,
    flags,
    float_at,
    floats,
    ints,
    long_at,
    put,
)
from impactlaw.stepping.time_stepping.compiled.borrow import borrow, is_damped
from impactlaw.stepping.time_stepping.compiled.contact import attempt, near
from impactlaw.stepping.time_stepping.compiled.ends import finish, look_again, update_frames, write_forces
from impactlaw.stepping.time_stepping.compiled.forces import inertial_work, lead_to, settle
from impactlaw.stepping.time_stepping.compiled.law import LawTable
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY, forget, last_step, remember
from impactlaw.stepping.time_stepping.compiled.state.status import FINE, HUGE_INPUT, HUGE_OUTPUT, TIMESTEP
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, World, setting
from impactlaw.stepping.time_stepping.compiled.sums import SUMS
from impactlaw.stepping.time_stepping.compiled.surfaces import (
    aim_surfaces,
    begin_surfaces,
    end_surfaces,
    place_surfaces,
    speeds_of_middle,
    surface_speed,
)
from impactlaw.stepping.time_stepping.inertial_forces import ROUNDS
from impactlaw.stepping.time_stepping.margins import set_margins
from impactlaw.stepping.time_stepping.tolerances import (
    FEW_ROUNDS,
    HUGE,
    LOOKS,
    MANY_ROUNDS,
    PHASE_LOOKS,
    SHARES,
    SHORTFALL_LIMIT,
    SLOWEST,
)

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_FEW, _AT_ONCE = np.int64(FEW_ROUNDS), np.bool_(False)  # literals would have functions compiled for each of them
_CONTACT_FULL, _ROWS_FULL = int(mujoco.mjtWarning.mjWARN_CONTACTFULL), int(mujoco.mjtWarning.mjWARN_CNSTRFULL)


@once
def _step(w, law, memory, margins, cone, loaded):
    nq, nv, h, sensors = size(w, MODEL.nq), w.nv, w.timestep, size(w, MODEL.nsensordata) > 0
    counts = memory.view(np.int64)
    at = MEMORY.left + nq
    left, gained = memory[MEMORY.left : at + nv], memory[at + nv : at + 2 * nv]
    qpos, qvel = data_floats(w, DATA.qpos, nq), velocity_of(w)
    same = counts[MEMORY.known] != 0 and _equal(left[:nq], qpos) and _equal(left[nq:], qvel)
    if loaded or not same:
        update_frames(w)
    if not same:
        forget(counts)
        gained[:] = 0.0
    if w.surfaces != 0:
        begin_surfaces(w)
    _set_margins(w, gained)
    start, middle, bias = copied(qvel), numbers(nq), zeros(nv)
    full = _to_midpoint(w, start, margins, middle, sensors)
    _free_step(w, start, bias, gained)
    if w.surfaces != 0:
        speeds_of_middle(w)
    collided, missed, touched, cut = False, 0.0, False, False
    if number(w, DATA.nefc) > 0:
        rounds = MANY_ROUNDS if counts[MEMORY.solved] != 0 else FEW_ROUNDS
        found = _contact(w, law, last_step(counts), start, bias, rounds)
        if found.status != FINE:
            memory[MEMORY.created] = found.created
            return found.status
        write_forces(w, found, start, cone)
        rows, shift, touched = found.rows, found.shift, len(found.x) > 0
        collided, missed, cut = found.collided, found.missed, found.later
        if len(found.sums) > 0:
            put(memory[MEMORY.sums : MEMORY.sums + SUMS], found.sums)
        if touched:
            remember(counts, rows.groups, rows.key, rows.rates[0], found.x)
        else:
            forget(counts)
        solved = missed <= SHORTFALL_LIMIT * max(SLOWEST, found.fastest) and not full
        counts[MEMORY.solved] = solved
        if sensors:
            _sense(w, start)
        _to_end(w, middle, shift)
        if _is_huge(qpos, qvel):
            return HUGE_OUTPUT
        if w.surfaces != 0:
            aim_surfaces(w)
        update_frames(w)
        if touched and solved:  # what is squeezed cannot be opened
            look_again(w, rows)
        if cut or not solved:
            memory[MEMORY.short_steps] += 1.0
    else:
        forget(counts)
        qacc = data_floats(w, DATA.qacc, nv)
        for i in range(nv):
            qacc[i] = (qvel[i] - start[i]) / h
        if sensors:
            _sense(w, start)
        _to_end(w, middle, middle[:0])
        if _is_huge(qpos, qvel):
            return HUGE_OUTPUT
        if w.surfaces != 0:
            aim_surfaces(w)
        update_frames(w)
    finish(w)
    if w.surfaces != 0:
        end_surfaces(w)
    counts[MEMORY.known] = 1
    left[:nq] = qpos
    left[nq:] = qvel
    memory[MEMORY.steps] += 1.0
    memory[MEMORY.impacts] += collided
    memory[MEMORY.collided] = collided
    memory[MEMORY.shortfall] = missed
    memory[MEMORY.worst] = max(memory[MEMORY.worst], missed)
    return FINE


@plain
def _equal(one, other):
    for i in range(len(one)):  # noqa: SIM110 - compiled
        if one[i] != other[i]:
            return False
    return True


@plain
def _is_huge(qpos, qvel):
    return not (norm(qpos) <= HUGE and norm(qvel) <= HUGE)


@once
def _set_margins(w, gained):
    """Let MuJoCo find the contacts that bodies can reach in this step; see `margins.set_margins`."""
    nbody = size(w, MODEL.nbody)
    ngeom, npair, ntendon = size(w, MODEL.ngeom), size(w, MODEL.npair), size(w, MODEL.ntendon)
    qvel, now = velocity_of(w), copied(data_floats(w, DATA.cvel, 6 * nbody)).reshape((nbody, 6))
    kept = copied(qvel)
    qvel += gained
    mj.com_vel(w.model, w.data)
    put(qvel, kept)
    gravity = floats(w.model + offset(w, MODEL.opt_gravity), 3)
    set_margins(
        model_floats(w, MODEL.body_margin, nbody), model_floats(w, MODEL.geom_margin, ngeom),
        model_floats(w, MODEL.geom_gap, ngeom), model_floats(w, MODEL.pair_margin, npair),
        model_floats(w, MODEL.pair_gap, npair), model_floats(w, MODEL.jnt_margin, size(w, MODEL.njnt)),
        model_floats(w, MODEL.tendon_margin, ntendon),
        model_ints(w, MODEL.geom_bodyid, ngeom), model_ints(w, MODEL.body_rootid, nbody), floats(w.sizes, nbody),
        rows_of(w, DATA.xipos, nbody, 3), rows_of(w, DATA.subtree_com, nbody, 3), now, rows_of(w, DATA.cvel, nbody, 6),
        model_ints(w, MODEL.body_mocapid, nbody), surface_speed(w), w.timestep,
        norm(gravity),
    )  # fmt: skip


@once
def _to_midpoint(w, start, margins, middle, sensors):
    """Put bodies where they are in the middle of the step, and compute all forces but those of contact there.

    Return whether MuJoCo had no room for all contacts.
    """
    if w.surfaces != 0:
        place_surfaces(w)
    qpos = data_floats(w, DATA.qpos, size(w, MODEL.nq))
    mj.integrate_pos(w.model, address_of(qpos), address_of(start), 0.5 * w.timestep)
    put(middle, qpos)
    full = _find_contacts(w, margins)
    if sensors:
        for field in (DATA.flg_subtreevel, DATA.flg_rnepost):  # what of the last step MuJoCo takes to be still right
            flags(w.data + offset(w, field), 1)[0] = 0
        mj.sensor_pos(w.model, w.data)
    mj.fwd_velocity(w.model, w.data)
    if sensors:
        mj.sensor_vel(w.model, w.data)
    mj.fwd_actuation(w.model, w.data)
    mj.fwd_acceleration(w.model, w.data)
    return full


@once
def _find_contacts(w, margins):
    warnings = ints(w.data + offset(w, DATA.warning), 2 * (max(_CONTACT_FULL, _ROWS_FULL) + 1))
    for share in SHARES:
        seen = warnings[2 * _CONTACT_FULL + 1] + warnings[2 * _ROWS_FULL + 1]
        mj.fwd_position(w.model, w.data)
        if warnings[2 * _CONTACT_FULL + 1] + warnings[2 * _ROWS_FULL + 1] == seen:
            return False
        for i in range(len(margins)):
            margins[i] *= share
    mj.fwd_position(w.model, w.data)
    return True


@once
def _free_step(w, start, bias, gained):
    """Let MuJoCo's integrator advance velocity, activations and time without contact."""
    nv = w.nv
    put(data_floats(w, DATA.qacc, nv), data_floats(w, DATA.qacc_smooth, nv))
    data_floats(w, DATA.qfrc_constraint, nv)[:] = 0.0
    if option(w, MODEL.opt_integrator) == _EULER:
        mj.euler(w.model, w.data)
    else:
        mj.implicit(w.model, w.data)
    qvel = velocity_of(w)
    if setting(w, SETTING.inertial) != 0.0:
        put(qvel, settle(w, start, bias))
    for i in range(nv):
        gained[i] = qvel[i] - start[i]


@once
def _contact(w, law, known, start, bias, rounds):
    """Add what contact does to the velocity, and return it; see `scheme.TimeStepping`."""
    h, qvel = w.timestep, velocity_of(w)
    free, jacobian, look, phases = copied(qvel), nonzeros_of(w), 1, _AT_ONCE
    chosen = near(w, jacobian, start, free, 2.0 * h)
    found = attempt(w, jacobian, chosen, start, free, known, rounds, law, phases)
    while look < LOOKS + PHASE_LOOKS and len(found.x) > 0 and found.status == FINE:
        more = near(w, jacobian, qvel, qvel, h) & ~chosen
        if more.any() and (look < LOOKS or phases):
            chosen = chosen | more
        elif found.later and not phases:
            phases = found.later
        else:
            break
        look += 1
        found = attempt(w, jacobian, chosen, start, free, _known(found, known), _FEW, law, phases)
    created = _created(w, found, start, bias)
    while look < LOOKS + PHASE_LOOKS + ROUNDS and created > found.rounding and found.status == FINE:
        before, was, look = free, created, look + 1
        free = lead_to(w, start, 0.5 * (start + qvel), bias)
        found = attempt(w, jacobian, chosen, start, free, _known(found, known), _FEW, law, phases)
        created = _created(w, found, start, bias)
        if not created < 0.5 * was:  # they turn too fast for that
            if created > was:
                found = attempt(w, jacobian, chosen, start, before, _known(found, known), _FEW, law, phases)
            break
    return found


@kernel
def _known(found, known):
    """Return groups, keys, coefficients and impulses that are known last."""
    if len(found.x) == 0:
        return known
    return found.rows.groups, found.rows.key, found.rows.rates[0], found.x


@plain
def _created(w, found, start, bias):
    """Return the work of contact in a collision and of Coriolis and gyroscopic forces, J; 0 where there is none."""
    if not found.collided or setting(w, SETTING.inertial) == 0.0:
        return 0.0
    work = found.work + inertial_work(w, start, velocity_of(w), bias)
    return abs(work) if setting(w, SETTING.restitution) == 1.0 else work


@kernel
def _sense(w, start):
    """Compute the sensors that depend on accelerations and forces, at the middle of the step."""
    qvel = velocity_of(w)
    after = copied(qvel)
    put(qvel, start)
    mj.sensor_acc(w.model, w.data)
    put(qvel, after)


@plain
def _to_end(w, middle, shift):
    """Put bodies where they are at the end of the step."""
    qpos = data_floats(w, DATA.qpos, len(middle))
    put(qpos, middle)
    mj.integrate_pos(w.model, address_of(qpos), address_of(velocity_of(w)), 0.5 * w.timestep)
    if len(shift):
        mj.integrate_pos(w.model, address_of(qpos), address_of(shift), w.timestep)


@compiled(
    "int64(int64,int64,int64,int64,int64,int64,int64,int64[::1],float64[::1],int64[::1],float64[::1],int64,float64[::1],"
    "float64[::1],boolean)"
)
def advance(
    user, data, scratch, table, settings, sizes, bilateral, keys, values, asked, memory, model, margins, state, loaded
):  # fmt: skip
    """Take one step and return how it has ended; data is back where it was if that is not `status.FINE`.

    Args:
        user: address of the model.
        data: address of its data.
        scratch: address of other data of the model.
        table: address of offsets of fields, see `fields`.
        settings: address of `world.Settings`.
        sizes: address of sizes of bodies, see `world.World`.
        bilateral: address of which equality constraints collisions must not violate, uint8 (neq,).
        keys: of the law's contacts, see `law.LawTable`, like the two that follow.
        values: restitution of each.
        asked: the key of a contact that is not known, (1,), to be written.
        memory: of the world, see `memory.Memory`.
        model: address of room for a copy of the model's structure.
        margins: room for its margins, `borrow.room`.
        state: room for the state, where that of the start is in the end.
        loaded: whether nothing but the state of data is current.
    """
    cone = borrow(user, model, margins, table, float_at(settings + 8 * SETTING.sticks) != 0.0)
    h = float_at(model + long_at(table + 8 * MODEL.opt_timestep))
    if not 0.0 < h < np.inf:
        return TIMESTEP
    mj.get_state(model, data, address_of(state), STATE)
    if not norm(state) <= HUGE:
        return HUGE_INPUT
    nv = long_at(model + long_at(table + 8 * MODEL.nv))
    surfaces = 0
    if float_at(settings + 8 * SETTING.surfaces) != 0.0:
        surfaces = address_of(memory) + 8 * (MEMORY.left + long_at(model + long_at(table + 8 * MODEL.nq)) + 2 * nv)
    w = World(model, data, scratch, table, settings, sizes, bilateral, nv, h, is_damped(model, table), surfaces)
    status = _step(w, LawTable(keys, values, asked), memory, margins, cone, loaded)
    if status != FINE:
        mj.set_state(user, data, address_of(state), STATE)
        mj.fwd_position(user, data)
    return status


linked_advance = linked(advance)
"""What compiled functions call."""
