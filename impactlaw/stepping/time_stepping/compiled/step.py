"""One step of `scheme.TimeStepping`, based on MuJoCo's C functions."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import (
    FIRST,
    clear,
    cleared,
    copied,
    integers,
    marks,
    norm,
    numbers,
    once,
    plain,
    put,
    zeros,
)
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    data_floats,
    jacobian_of,
    layout_of_trees,
    number,
    offset,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import (
    DATA,
    MODEL,
    address_of,
    float_at,
    floats,
    int_at,
    keep,
    long_at,
    longs,
    put_int,
)
from impactlaw.stepping.integration import STEP_STATE
from impactlaw.stepping.time_stepping.compiled.detection.far_contacts import take_far_back
from impactlaw.stepping.time_stepping.compiled.detection.unseen_overlaps import begins_overlapping
from impactlaw.stepping.time_stepping.compiled.ending import end_step, finish
from impactlaw.stepping.time_stepping.compiled.impulses.working_set import find_impulses
from impactlaw.stepping.time_stepping.compiled.limits import passes_limit
from impactlaw.stepping.time_stepping.compiled.margins import find_sizes
from impactlaw.stepping.time_stepping.compiled.midpoint import (
    begin,
    detect_farther,
    detect_limits,
    free_step,
    outrun,
    to_midpoint,
)
from impactlaw.stepping.time_stepping.compiled.model_copy import copy_model, is_damped
from impactlaw.stepping.time_stepping.compiled.state.hook import CONTROL, ERROR, HOOK, hooked, notify
from impactlaw.stepping.time_stepping.compiled.state.law import LawTable
from impactlaw.stepping.time_stepping.compiled.state.memory import (
    FRAME,
    MEMORY,
    forget,
    found_so_far,
    keep_frames,
    last_step,
    remember,
    remember_so_far,
)
from impactlaw.stepping.time_stepping.compiled.state.room import SUMS, answer_at, lay_out, rows_at, velocities_at
from impactlaw.stepping.time_stepping.compiled.state.status import (
    FARTHER,
    FINE,
    HUGE_INPUT,
    OVERRIDDEN,
    RAISED,
    TIMESTEP,
    UNSEEN,
)
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, World, setting
from impactlaw.stepping.time_stepping.problem.energy import is_met
from impactlaw.stepping.time_stepping.problem.gradient_turns import write_turns
from impactlaw.stepping.time_stepping.problem.rows import entries_of
from impactlaw.stepping.time_stepping.problem.solution.scaling import RESERVE
from impactlaw.stepping.time_stepping.tolerances import FEW_ROUNDS, HUGE, MANY_ROUNDS, SHORTFALL_LIMIT, WIDER_DETECTIONS

_OVERRIDE = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)


@plain
def _finish(w, memory, counts, left, frames, collided, missed):
    """Write the remaining outputs of a step beside the state."""
    counts[MEMORY.known] = 1
    nq = size(w, MODEL.nq)
    put(left, data_floats(w, DATA.qpos, nq))
    put(left[nq:], velocity_of(w))
    keep_frames(w, frames)
    memory[MEMORY.steps] += 1.0
    memory[MEMORY.impacts] += collided
    memory[MEMORY.collided] = collided
    memory[MEMORY.shortfall] = missed
    memory[MEMORY.worst] = max(memory[MEMORY.worst], missed)


@plain
def _constrain(
    w, law, memory, counts, held, begun, start, middle, bias, turning, gravity, full, cone, jacobian, chosen, seen,
    doubtful, force, pairs, gaps, room, narrow, may, work, space,
):  # fmt: skip
    """Take the rest of a step with constraints, from its middle.

    If the step `may` detect contacts farther away and detection was too narrow, the function returns without taking the
    rest, provided that at least as much work is left as was used of ``work``: otherwise a further attempt would find
    worse impulses. ``space``, (2 nbody,), is scratch space.

    Return how the step has ended, whether any contact collides, and by how much contact velocities miss the law.
    """
    rounds = MANY_ROUNDS if counts[MEMORY.solved] != 0 else FEW_ROUNDS
    found = find_impulses(
        w, law, memory, found_so_far(counts), start, middle, bias, turning, gravity, rounds, jacobian, chosen, seen,
        doubtful, room, narrow,
    )  # fmt: skip
    solved, rows = found.solved, rows_at(room.rows, found.groups, found.rows, room.entries)
    if solved.status != FINE:
        memory[MEMORY.created] = solved.created
        return solved.status, False, 0.0
    answer, touched = answer_at(room.answer, found.groups, found.rows, w.nv), found.rows > 0
    outruns = not full and solved.collided and outrun(w, space)
    if outruns and may and floats(w.work, 1)[0] - RESERVE > work - floats(w.work, 1)[0]:
        remember_so_far(counts, rows, answer.x)
        return FARTHER, False, 0.0
    unseen = counts[MEMORY.known] != 0 and begins_overlapping(w, rows, last_step(counts).key, begun)
    clear(held)
    if touched and not solved.collided:
        free, after = velocities_at(room, 0, 1), velocity_of(w)
        for i in range(w.nv):
            held[i] = after[i] - free[i]
    if touched:
        if setting(w, SETTING.sums) != 0.0:
            put(memory[MEMORY.sums : MEMORY.sums + SUMS], floats(room.sums, SUMS))
        write_turns(rows, answer.x, answer.reached, answer.sliding, answer.z)
        remember(counts, rows, answer.x)
    else:
        forget(counts)
    met = is_met(solved.missed, solved.fastest) and not full
    counts[MEMORY.solved] = met and not found.later and not outruns
    status, remains = end_step(
        w, rows, answer.x, start, middle, answer.shift, solved.opens, met, cone, force, pairs, gaps
    )  # fmt: skip
    if status == FINE:
        short = counts[MEMORY.solved] == 0 or solved.residual > SHORTFALL_LIMIT
        memory[MEMORY.short_steps] += short or remains or unseen
        memory[MEMORY.inadmissible] += solved.collided and (solved.share < 1.0 or solved.created > 0.0)
    return status, solved.collided, solved.missed


@once
def _step(w, law, memory, margins, cone, loaded):
    nq, nv = size(w, MODEL.nq), w.nv
    counts, at = memory.view(np.int64), MEMORY.left + nq
    left, gained = memory[MEMORY.left : at + nv], memory[at + nv : at + 2 * nv]
    held, turning, gravity = memory[at + 2 * nv : at + 3 * nv], cleared(size(w, MODEL.ntree)), numbers(nv)
    frames = memory[at + 3 * nv : at + 3 * nv + FRAME * size(w, MODEL.nbody)]
    start, middle, bias = numbers(nv), numbers(nq), zeros(nv)
    begun = copied(data_floats(w, DATA.qpos, nq))
    work = numbers(max(11 * size(w, MODEL.nbody) + len(margins), 6 * size(w, MODEL.nbody) + nv, 3 * nv))
    begin(w, counts, left, frames, gained, held, loaded)
    full = to_midpoint(w, gained, start, middle, work)
    if w.python != 0:
        hook = longs(w.python, len(HOOK))
        hook[HOOK.middle], hook[HOOK.damped] = address_of(middle), w.damped
        if hooked(w, HOOK.controls) and notify(w, CONTROL) == ERROR:
            return RAISED
    free_step(w, start, held, bias, turning, gravity, gained, work)
    free, status, collided, missed, farther, allowed = copied(velocity_of(w)), FARTHER, False, 0.0, 0, 1.0
    narrow = True
    while status == FARTHER:
        n = number(w, DATA.nefc)
        if narrow and (take_far_back(w, start) or passes_limit(w, middle, 2.0 * w.timestep, free, False)):
            full, narrow = detect_limits(w, start, free, middle) or full, False
            continue
        if n == 0:
            put_int(w.data + offset(w, DATA.ncon), np.int32(0))
            forget(counts)
            clear(held)
            if full:
                counts[MEMORY.solved] = 0
                memory[MEMORY.short_steps] += 1.0
            status, _ = end_step(
                w, rows_at(0, 0, 0, 0), bias[:0], start, middle, bias, False, False, cone, bias[:0], integers(0),
                bias[:0],
            )  # fmt: skip
            break
        jacobian, chosen, seen, mark = jacobian_of(w, False), marks(n), marks(n), cleared(size(w, MODEL.ntree))
        entries = entries_of(jacobian, layout_of_trees(w), mark)
        block, force = numbers(lay_out(FIRST, n, entries, nv)[1]), numbers(n)
        pairs, gaps = integers(2 * number(w, DATA.ncon)), numbers(number(w, DATA.ncon))
        doubtful = cleared(number(w, DATA.ncon))
        room = lay_out(address_of(block), n, entries, nv)[0]
        status, collided, missed = _constrain(
            w, law, memory, counts, held, begun, start, middle, bias, turning, gravity, full, cone, jacobian, chosen,
            seen, doubtful, force, pairs, gaps, room, narrow, farther < WIDER_DETECTIONS, allowed, work,
        )  # fmt: skip
        keep(block)
        if status == FARTHER:
            full, narrow, farther = detect_farther(w, start, free, middle, work), False, farther + 1
            allowed = floats(w.work, 1)[0]
        elif status == UNSEEN:
            full, narrow, status = detect_limits(w, start, free, middle) or full, False, FARTHER
            memory[MEMORY.work] = 1.0 if counts[MEMORY.found_rows] == 0 else memory[MEMORY.found_work]
    if status == FINE:
        finish(w, begun, start, turning, gravity)
        _finish(w, memory, counts, left, frames, collided, missed)
    return status


@linked(
    "int64(int64,int64,int64,int64,int64,int64,int64,int64[::1],float64[::1],int64[::1],float64[::1],int64,float64[::1],"
    "float64[::1],boolean,int64)"
)
def advance(
    user, data, scratch, table, settings, carriers, bilateral, keys, values, asked, memory, model, margins, state,
    loaded, python,
):  # fmt: skip
    """Take one step and return how it has ended; if that is not `status.FINE`, data is restored.

    Args:
        user: address of the model.
        data: address of its data.
        scratch: address of other data of the model.
        table: address of offsets of fields, see `fields`.
        settings: address of `world.Settings`.
        carriers: address of the mocap body that carries each geom, see `Surfaces`, int32 (ngeom,).
        bilateral: address of kinds of equality constraints, 0 if collisions may violate them, uint8 (neq,).
        keys: keys of the law's contacts, see `law.LawTable`, like the next two.
        values: restitution of these contacts.
        asked: key of a contact that is not known, (1,), written.
        memory: memory of the world, see `memory.Memory`.
        model: address of room for a copy of the model's structure, see `copy_model`.
        margins: room for its margins, `model_copy.room`.
        state: room for the state; at the end it holds the state from the start of the step.
        loaded: whether only the state of data is current.
        python: see `world.World`.
    """
    cone = copy_model(user, model, margins, table, float_at(settings + 8 * SETTING.sticks) != 0.0)
    h = float_at(model + long_at(table + 8 * MODEL.opt_timestep))
    if not 0.0 < h < np.inf:
        return TIMESTEP
    enabled = int_at(user + long_at(table + 8 * MODEL.opt_enableflags))
    if enabled & _OVERRIDE and float_at(settings + 8 * SETTING.frictional) != 0.0:
        return OVERRIDDEN
    mj.get_state(model, data, address_of(state), STEP_STATE)
    if not norm(state) <= HUGE:
        return HUGE_INPUT
    nv = long_at(model + long_at(table + 8 * MODEL.nv))
    nbody = long_at(model + long_at(table + 8 * MODEL.nbody))
    nmocap = long_at(model + long_at(table + 8 * MODEL.nmocap))
    surfaces = 0
    if float_at(settings + 8 * SETTING.surfaces) != 0.0:
        begin = MEMORY.left + long_at(model + long_at(table + 8 * MODEL.nq)) + 3 * nv + FRAME * nbody
        surfaces = address_of(memory) + 8 * begin
    work = address_of(memory) + 8 * MEMORY.work
    sizes, damped = numbers(nbody + nmocap), is_damped(model, table)
    w = World(
        model, data, scratch, table, settings, address_of(sizes), bilateral, nv, h, damped, surfaces, work, python
    )
    find_sizes(w, carriers)
    memory.view(np.int64)[MEMORY.found_rows] = 0
    memory[MEMORY.work] = 1.0
    status = _step(w, LawTable(keys, values, asked), memory, margins, cone, loaded)
    if status != FINE:
        mj.set_state(user, data, address_of(state), STEP_STATE)
        if status != RAISED:  # a filter of contacts in Python must not be called after an error
            mj.fwd_position(user, data)
    keep(sizes)
    return status
