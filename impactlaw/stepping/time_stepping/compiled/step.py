"""One step of `scheme.TimeStepping` in compiled code, over MuJoCo's C functions; see there what each part is for."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import compiled
from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import (
    FIRST,
    cleared,
    copied,
    kernel,
    marks,
    norm,
    numbers,
    once,
    plain,
    zeros,
)
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
    keep,
    long_at,
    put,
    table_floats,
)
from impactlaw.stepping.time_stepping.compiled.borrow import borrow, is_damped
from impactlaw.stepping.time_stepping.compiled.contact import count_entries
from impactlaw.stepping.time_stepping.compiled.ends import (
    finish,
    look_again,
    update_frames,
    write_acceleration,
    write_forces,
)
from impactlaw.stepping.time_stepping.compiled.forces import settle
from impactlaw.stepping.time_stepping.compiled.impulses import find_impulses
from impactlaw.stepping.time_stepping.compiled.law import LawTable
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY, forget, last_step, remember
from impactlaw.stepping.time_stepping.compiled.state.room import answer_at, lay_out, rows_at
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
from impactlaw.stepping.time_stepping.margins import write_margins
from impactlaw.stepping.time_stepping.tolerances import (
    FEW_ROUNDS,
    HUGE,
    MANY_ROUNDS,
    SHARES,
    SHORTFALL_LIMIT,
    SLOWEST,
)

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_CONTACT_FULL, _ROWS_FULL = int(mujoco.mjtWarning.mjWARN_CONTACTFULL), int(mujoco.mjtWarning.mjWARN_CNSTRFULL)


@plain
def _begin(w, counts, left, gained, loaded):
    """Let data be current, and forget what is not of the last step."""
    nq = size(w, MODEL.nq)
    qpos, qvel = data_floats(w, DATA.qpos, nq), velocity_of(w)
    same = counts[MEMORY.known] != 0 and _equal(left[:nq], qpos) and _equal(left[nq:], qvel)
    if loaded or not same:
        update_frames(w)
    if not same:
        forget(counts)
        gained[:] = 0.0
    if w.surfaces != 0:
        begin_surfaces(w)


@plain
def _end(w, start, middle, shift, opens):
    """Let data be at the end of the step, with frames that are current; return `status.FINE`, or that it is huge."""
    if size(w, MODEL.nsensordata) > 0:
        _sense(w, start)
    _to_end(w, middle, shift, opens)
    if _is_huge(data_floats(w, DATA.qpos, len(middle)), velocity_of(w)):
        return HUGE_OUTPUT
    if w.surfaces != 0:
        aim_surfaces(w)
    update_frames(w)
    return FINE


@plain
def _finish(w, memory, counts, left, collided, missed):
    """Leave what a step leaves beside the state."""
    finish(w)
    if w.surfaces != 0:
        end_surfaces(w)
    counts[MEMORY.known] = 1
    nq = size(w, MODEL.nq)
    put(left, data_floats(w, DATA.qpos, nq))
    put(left[nq:], velocity_of(w))
    memory[MEMORY.steps] += 1.0
    memory[MEMORY.impacts] += collided
    memory[MEMORY.collided] = collided
    memory[MEMORY.shortfall] = missed
    memory[MEMORY.worst] = max(memory[MEMORY.worst], missed)


@plain
def _constrain(w, law, memory, counts, start, middle, bias, full, cone, jacobian, chosen, seen, mark, force, room):
    """Take the rest of a step that has constraints, from its middle.

    Return how it has ended, whether some contact collides, and by how much contact velocities miss the law.
    """
    rounds = MANY_ROUNDS if counts[MEMORY.solved] != 0 else FEW_ROUNDS
    found = find_impulses(w, law, last_step(counts), start, bias, rounds, jacobian, chosen, seen, mark, room)
    solved = found.solved
    if solved.status != FINE:
        memory[MEMORY.created] = solved.created
        return solved.status, False, 0.0
    rows = rows_at(room.rows, found.groups, found.rows, room.entries)
    answer, touched = answer_at(room.answer, found.groups, found.rows, w.nv), found.rows > 0
    write_forces(w, rows, answer.x, start, cone, force)
    if touched:
        if setting(w, SETTING.told) != 0.0:
            put(memory[MEMORY.sums : MEMORY.sums + SUMS], floats(room.sums, SUMS))
        remember(counts, rows.groups, rows.key, rows.rates[0], answer.x)
    else:
        forget(counts)
    met = solved.missed <= SHORTFALL_LIMIT * max(SLOWEST, solved.fastest) and not full
    counts[MEMORY.solved] = met
    status = _end(w, start, middle, answer.shift, solved.opens)
    if status == FINE and touched and met:  # what is squeezed cannot be opened
        look_again(w, rows)
    if status == FINE and (found.later or not met):
        memory[MEMORY.short_steps] += 1.0
    return status, solved.collided, solved.missed


@once
def _step(w, law, memory, margins, cone, loaded):
    nq, nv = size(w, MODEL.nq), w.nv
    counts, at = memory.view(np.int64), MEMORY.left + nq
    left, gained = memory[MEMORY.left : at + nv], memory[at + nv : at + 2 * nv]
    start, middle, bias = numbers(nv), numbers(nq), zeros(nv)
    work = numbers(max(6 * size(w, MODEL.nbody) + nv, 3 * nv))
    full = _to_middle(w, counts, left, gained, start, middle, bias, margins, work, loaded)
    n, status, collided, missed = number(w, DATA.nefc), FINE, False, 0.0
    if n > 0:
        jacobian, chosen, seen, mark = nonzeros_of(w), marks(n), marks(n), cleared(size(w, MODEL.ntree))
        entries = count_entries(w, jacobian, mark)
        block, force = numbers(lay_out(FIRST, n, entries, nv)[1]), numbers(n)
        room = lay_out(address_of(block), n, entries, nv)[0]
        status, collided, missed = _constrain(
            w, law, memory, counts, start, middle, bias, full, cone, jacobian, chosen, seen, mark, force, room
        )
        keep(block)
    else:
        forget(counts)
        write_acceleration(w, start)
        status = _end(w, start, middle, bias, False)
    if status == FINE:
        _finish(w, memory, counts, left, collided, missed)
    return status


@plain
def _to_middle(w, counts, left, gained, start, middle, bias, margins, work, loaded):
    """Take a step without contact, bodies left in its middle; return whether MuJoCo had no room for all contacts."""
    _begin(w, counts, left, gained, loaded)
    _set_margins(w, gained, work)
    put(start, velocity_of(w))
    full = _to_midpoint(w, start, margins, middle)
    _free_step(w, start, bias, gained, work)
    if w.surfaces != 0:
        speeds_of_middle(w)
    return full


@plain
def _equal(one, other):
    for i in range(len(one)):  # noqa: SIM110 - compiled
        if one[i] != other[i]:
            return False
    return True


@plain
def _is_huge(qpos, qvel):
    return not (norm(qpos) <= HUGE and norm(qvel) <= HUGE)


@plain
def _set_margins(w, gained, work):
    """Let MuJoCo find the contacts that bodies can reach in this step; see `margins.set_margins`.

    There is room for what is moved meanwhile, (6 nbody + nv,).
    """
    nbody = size(w, MODEL.nbody)
    ngeom, npair, ntendon = size(w, MODEL.ngeom), size(w, MODEL.npair), size(w, MODEL.ntendon)
    qvel, moving, kept = velocity_of(w), data_floats(w, DATA.cvel, 6 * nbody), work[6 * nbody :]
    now = table_floats(address_of(work), nbody, 6)
    put(work, moving)
    put(kept, qvel)
    for i in range(w.nv):
        qvel[i] += gained[i]
    mj.com_vel(w.model, w.data)
    put(qvel, kept[: w.nv])
    gravity = floats(w.model + offset(w, MODEL.opt_gravity), 3)
    write_margins(
        model_floats(w, MODEL.body_margin, nbody), model_floats(w, MODEL.geom_margin, ngeom),
        model_floats(w, MODEL.geom_gap, ngeom), model_floats(w, MODEL.pair_margin, npair),
        model_floats(w, MODEL.pair_gap, npair), model_floats(w, MODEL.jnt_margin, size(w, MODEL.njnt)),
        model_floats(w, MODEL.tendon_margin, ntendon),
        model_ints(w, MODEL.geom_bodyid, ngeom), model_ints(w, MODEL.body_rootid, nbody), floats(w.sizes, nbody),
        rows_of(w, DATA.xipos, nbody, 3), rows_of(w, DATA.subtree_com, nbody, 3), now, rows_of(w, DATA.cvel, nbody, 6),
        model_ints(w, MODEL.body_mocapid, nbody), surface_speed(w), w.timestep,
        norm(gravity),
    )  # fmt: skip


@plain
def _to_midpoint(w, start, margins, middle):
    """Put bodies where they are in the middle of the step, and compute all forces but those of contact there.

    Return whether MuJoCo had no room for all contacts.
    """
    if w.surfaces != 0:
        place_surfaces(w)
    qpos, sensors = data_floats(w, DATA.qpos, size(w, MODEL.nq)), size(w, MODEL.nsensordata) > 0
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


@plain
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


@plain
def _free_step(w, start, bias, gained, work):
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
        settle(w, start, bias, work)
    for i in range(nv):
        gained[i] = qvel[i] - start[i]


@kernel
def _sense(w, start):
    """Compute the sensors that depend on accelerations and forces, at the middle of the step."""
    qvel = velocity_of(w)
    after = copied(qvel)
    put(qvel, start)
    mj.sensor_acc(w.model, w.data)
    put(qvel, after)


@plain
def _to_end(w, middle, shift, opens):
    """Put bodies where they are at the end of the step."""
    qpos = data_floats(w, DATA.qpos, len(middle))
    put(qpos, middle)
    mj.integrate_pos(w.model, address_of(qpos), address_of(velocity_of(w)), 0.5 * w.timestep)
    if opens:
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
