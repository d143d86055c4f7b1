"""The looks at contacts of one step in compiled code: what is near, what contact does, and what energy that has."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import once, plain, put
from impactlaw.stepping.compiled.access import velocity_of
from impactlaw.stepping.compiled.fields import floats
from impactlaw.stepping.time_stepping.compiled.impulses.answer import Solved, work_left
from impactlaw.stepping.time_stepping.compiled.impulses.contact import (
    Outcome,
    linked_attempt,
    near,
    sees_more,
    take_over,
)
from impactlaw.stepping.time_stepping.compiled.impulses.forces import inertial_work, lead_to, mean_of
from impactlaw.stepping.time_stepping.compiled.limits import passes_limit
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY, remember_so_far
from impactlaw.stepping.time_stepping.compiled.state.room import answer_at, keep_known, known_at, rows_at, velocities_at
from impactlaw.stepping.time_stepping.compiled.state.status import FINE, UNSEEN
from impactlaw.stepping.time_stepping.compiled.state.sums import SUMS
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.inertial_forces import ROUNDS
from impactlaw.stepping.time_stepping.problem.energy import is_met
from impactlaw.stepping.time_stepping.tolerances import FEW_ROUNDS, LOOKS, PHASE_LOOK_ROWS, PHASE_LOOKS

_UNSEEN = Solved(False, False, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, UNSEEN, True)
_FEW, _AT_ONCE = np.int64(FEW_ROUNDS), np.bool_(False)


@plain
def _again(w, law, start, free, jacobian, chosen, mark, room, found, phases):
    """Solve the problem once more, from what is found."""
    rows = rows_at(room.rows, found.groups, found.rows, room.entries)
    known, last = known_at(room.known, found.groups, found.rows), answer_at(room.answer, found.groups, found.rows, w.nv)
    keep_known(known, rows.groups, rows.key, rows.rates[0], last.x)
    sums = floats(room.sums, SUMS)
    return linked_attempt(w, jacobian, chosen, start, free, known, _FEW, law, phases, mark, room, sums)


@plain
def _keep(w, memory, room, found):
    """Keep what the first look has found: what is taken again for a limit goes on from there."""
    if found.solved.sharp:
        rows = rows_at(room.rows, found.groups, found.rows, room.entries)
        last = answer_at(room.answer, found.groups, found.rows, w.nv)
        remember_so_far(memory.view(np.int64), rows.groups, rows.key, rows.rates[0], last.x)
        memory[MEMORY.found_work] = floats(w.work, 1)[0]


@once
def find_impulses(w, law, memory, known, start, middle, bias, rounds, jacobian, chosen, seen, mark, room, narrow):
    """Add what contact does to the velocity, and return it; see `scheme.TimeStepping`.

    Args:
        w: the world in the middle of the step.
        law: see `law`.
        memory: of the world, see `memory.Memory`.
        known: groups, keys, coefficients and impulses of the last step.
        start: velocity at the start, (nv,).
        middle: position in the middle of the step, (nq,).
        bias: inertial forces, (nv,), to be written.
        rounds: of the slower solvers.
        jacobian: `access.nonzeros_of`.
        chosen: room for marks of MuJoCo's rows, (nefc,).
        seen: the same once more.
        mark: marks of trees, False.
        room: see `state.room`.
        narrow: whether limits of joints were left out; the status is `UNSEEN` if one of them would be passed.
    """
    h, qvel, free, look, phases = w.timestep, velocity_of(w), velocities_at(room, 0, 1), 1, _AT_ONCE
    put(free, qvel)
    near(w, jacobian, start, free, 2.0 * h, chosen)
    found = linked_attempt(
        w, jacobian, chosen, start, free, known, rounds, law, phases, mark, room, floats(room.sums, SUMS)
    )  # fmt: skip
    while look < LOOKS + PHASE_LOOKS and found.rows > 0 and found.solved.status == FINE:
        if narrow and passes_limit(w, middle, h):
            if look == 1:
                _keep(w, memory, room, found)
            return Outcome(0, 0, _UNSEEN, False)
        near(w, jacobian, qvel, qvel, h, seen)
        allowed = found.rows <= PHASE_LOOK_ROWS if phases else look < LOOKS
        if sees_more(chosen, seen) and allowed:
            take_over(chosen, seen)
        elif found.later and not phases and work_left(w) and is_met(found.solved.missed, found.solved.fastest):
            phases = found.later
        else:
            break
        if look == 1:
            _keep(w, memory, room, found)
        look += 1
        found = _again(w, law, start, free, jacobian, chosen, mark, room, found, phases)
    return _less_energy(w, law, start, bias, free, jacobian, chosen, mark, room, found, phases, look)


@once
def _less_energy(w, law, start, bias, free, jacobian, chosen, mark, room, found, phases, look):
    """Let inertial forces be those of the mean velocity while a collision creates energy with them."""
    qvel, before, mean = velocity_of(w), velocities_at(room, 1, 1), velocities_at(room, 2, 1)
    created = _created(w, found, start, bias)
    while look < LOOKS + PHASE_LOOKS + ROUNDS and created > found.solved.rounding and found.solved.status == FINE:
        was, look = created, look + 1
        put(before, free)
        mean_of(start, qvel, mean)
        lead_to(w, start, mean, bias, free)
        found = _again(w, law, start, free, jacobian, chosen, mark, room, found, phases)
        created = _created(w, found, start, bias)
        if not created < 0.5 * was:  # they turn too fast for that
            if created > was:
                found = _again(w, law, start, before, jacobian, chosen, mark, room, found, phases)
            break
    return found


@plain
def _created(w, found, start, bias):
    """Return the work of contact in a collision and of Coriolis and gyroscopic forces, J; 0 where there is none."""
    if not found.solved.collided or setting(w, SETTING.inertial) == 0.0:
        return 0.0
    work = found.solved.work + inertial_work(w, start, velocity_of(w), bias)
    return abs(work) if setting(w, SETTING.restitution) == 1.0 else work
