"""Find the impulses of a step by a working set of contacts; it grows by those that the resulting velocity closes."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import clear, once, plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import velocity_of
from impactlaw.stepping.compiled.fields import floats
from impactlaw.stepping.time_stepping.compiled.detection.chosen_rows import choose, look
from impactlaw.stepping.time_stepping.compiled.impulses.answer import NO_ANSWER
from impactlaw.stepping.time_stepping.compiled.impulses.contact_problem import Outcome, attempt, sees_more
from impactlaw.stepping.time_stepping.compiled.impulses.forces import created, forces_at, half, split, stale
from impactlaw.stepping.time_stepping.compiled.limits import passes_limit
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY, remember_so_far
from impactlaw.stepping.time_stepping.compiled.state.room import answer_at, keep_known, known_at, rows_at, velocities_at
from impactlaw.stepping.time_stepping.compiled.state.status import FINE, UNSEEN
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.inertial_forces import ROUNDS, SMALL_PART
from impactlaw.stepping.time_stepping.problem.energy import is_met
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import TOLERANCE
from impactlaw.stepping.time_stepping.tolerances import FEW_ROUNDS, PHASE_SET_ROWS, PHASE_SETS, SETS

_UNSEEN = NO_ANSWER._replace(status=UNSEEN)
_FEW, _AT_ONCE = np.int64(FEW_ROUNDS), np.bool_(False)


@plain
def _again(w, law, start, moved, free, jacobian, chosen, room, found, phases):
    """Solve the problem again, starting from a result."""
    rows = rows_at(room.rows, found.groups, found.rows, room.entries)
    known, last = known_at(room.known, found.groups, found.rows), answer_at(room.answer, found.groups, found.rows, w.nv)
    keep_known(known, rows, last.x)
    return attempt(w, jacobian, chosen, start, moved, free, known, _FEW, law, phases, room)


@plain
def _keep(w, memory, room, found):
    """Keep the result of the first working set, from which a step that is taken again for a limit continues."""
    if found.solved.residual <= TOLERANCE and found.solved.share == 1.0:
        rows = rows_at(room.rows, found.groups, found.rows, room.entries)
        last = answer_at(room.answer, found.groups, found.rows, w.nv)
        remember_so_far(memory.view(np.int64), rows, last.x)
        memory[MEMORY.found_work] = floats(w.work, 1)[0]


@once
def find_impulses(
    w, law, memory, known, start, middle, bias, turning, gravity, rounds, jacobian, chosen, seen, doubtful, room,
    narrow,
):  # fmt: skip
    """Add the effect of contact to the velocity, and return it; see `scheme.TimeStepping`.

    Contacts that are far from closing are left out, and those that bodies may pass over, see `passed_edges`. If the
    resulting velocity would close one of them, it joins the next working set. If contacts are hit only through others,
    the others collide first, which may close further contacts. The same is tried if a few sets do not hold everything
    that closes. If Coriolis and gyroscopic forces create energy because of a collision, the collision is put between
    two half steps.

    Args:
        w: the world in the middle of the step.
        law: see `law`.
        memory: memory of the world, see `memory.Memory`.
        known: see `rows.Known`.
        start: velocity at the start, (nv,).
        middle: position in the middle of the step, (nq,).
        turning: trees of bodies that turn too fast, bool (ntree,); further trees are marked here.
        gravity: room for the force of gravity, (nv,), if there are such trees.
        bias: inertial forces, with gravity, that gave the velocity without contact, (nv,).
        rounds: rounds of the slower solvers.
        jacobian: `access.jacobian_of`, without zeros.
        chosen: room for marks of MuJoCo's rows, (nefc,).
        seen: room for marks of MuJoCo's rows, (nefc,).
        doubtful: room for marks of contacts, False, (ncon,).
        room: see `state.room`.
        narrow: whether limits of joints were left out; the status is `UNSEEN` if one of them would be passed.
    """
    h, free, sets, phases = w.timestep, velocities_at(room, 0, 1), 1, _AT_ONCE
    still, unseen, begun = free[:0], False, floats(w.work, 1)[0]
    put(free, velocity_of(w))
    doubts = choose(w, jacobian, start, free, middle, chosen, seen, doubtful)
    found = attempt(w, jacobian, chosen, start, still, free, known, rounds, law, phases, room)
    while (doubts or found.rows > 0) and found.solved.status == FINE:
        shift = answer_at(room.answer, found.groups, found.rows, w.nv).shift
        if narrow and passes_limit(w, middle, h, shift, found.solved.opens):
            if sets == 1:
                _keep(w, memory, room, found)
            return Outcome(0, 0, _UNSEEN, False)
        look(w, jacobian, middle, doubts, chosen, seen, doubtful)
        more, unseen = sets < SETS + PHASE_SETS, sees_more(chosen, seen)
        allowed = found.rows <= PHASE_SET_ROWS if phases else sets < SETS
        met = is_met(found.solved.missed, found.solved.fastest)
        if more and unseen and allowed:
            np.logical_or(chosen, seen, chosen)
        elif more and not phases and (unseen or found.later) and 2.0 * floats(w.work, 1)[0] > begun and met:
            np.logical_or(chosen, seen, chosen)
            phases = unseen or found.later
        else:
            break
        if sets == 1:
            _keep(w, memory, room, found)
        sets += 1
        found = _again(w, law, start, still, free, jacobian, chosen, room, found, phases)
    if found.solved.status == FINE:  # else there is no answer yet
        found = _less_energy(w, law, start, bias, turning, gravity, free, jacobian, chosen, room, found, phases)
    return Outcome(found.groups, found.rows, found.solved, found.later or unseen)


@once
def _less_energy(w, law, start, bias, turning, gravity, free, jacobian, chosen, room, found, phases):
    """Put a collision between two half steps if it creates energy together with inertial forces.

    After a collision, the velocities of bodies are then those of the velocity after it.
    """
    if not found.solved.collided:
        return found
    if setting(w, SETTING.inertial) == 0.0:
        mj.com_vel(w.model, w.data)
        return found
    own = created(w, start, bias, velocities_at(room, 1, 1))
    gains = _size(w, found.solved.work + own, found)
    if not gains > found.solved.rounding or _size(w, own, found) < SMALL_PART * gains:
        return found
    h, after, mean, last = w.timestep, velocity_of(w), velocities_at(room, 1, 1), velocities_at(room, 2, 1)
    begin, end = velocities_at(room, 3, 1), velocities_at(room, 4, 1)
    used, moved, best = velocities_at(room, 5, 1), velocities_at(room, 6, 1), velocities_at(room, 7, 2)
    clear(mean)
    forces_at(w, mean, gravity)
    settled = half(w, start, gravity, -h, turning, mean, last, begin)
    settled = half(w, after, gravity, h, turning, mean, last, end) and settled
    put(best, free)
    clear(best[w.nv :])
    least, was, rounds = gains, np.inf, ROUNDS if settled else 0
    for _ in range(rounds):
        put(used, end)
        split(w, start, gravity, begin, used, mean, moved, free)
        found = _again(w, law, start, moved, free, jacobian, chosen, room, found, phases)
        if found.solved.status != FINE:
            return found
        half(w, after, gravity, h, turning, mean, last, end)
        gains = _size(w, found.solved.work + stale(w, after, end, used, mean), found)
        if gains < least:
            least = gains
            put(best, free)
            put(best[w.nv :], moved)
        if not found.solved.rounding < gains < 0.5 * was:
            break
        was = gains
    if not gains <= least:
        found = _again(w, law, start, best[w.nv :], best[: w.nv], jacobian, chosen, room, found, phases)
    mj.com_vel(w.model, w.data)
    return found


@plain
def _size(w, work, found):
    """Return the energy that a collision creates; its absolute value if energy must not be lost, either."""
    slides = setting(w, SETTING.frictional) != 0.0 and found.rows > found.groups
    return abs(work) if setting(w, SETTING.restitution) == 1.0 and not slides else work
