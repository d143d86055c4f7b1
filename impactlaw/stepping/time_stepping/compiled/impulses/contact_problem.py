"""The contact problem of a step: the rows that are near, and their impulses."""

from __future__ import annotations

from typing import NamedTuple

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import clear, once, plain
from impactlaw.stepping.compiled.access import row_floats, velocity_of
from impactlaw.stepping.compiled.fields import DATA, floats
from impactlaw.stepping.time_stepping.compiled.detection.carriers import add_surfaces
from impactlaw.stepping.time_stepping.compiled.impulses.answer import (
    NO_ANSWER,
    STOPPED,
    Solved,
    goes_on,
    lost,
    scalable,
    solve,
)
from impactlaw.stepping.time_stepping.compiled.impulses.phases import resolve_in_phases
from impactlaw.stepping.time_stepping.compiled.impulses.rows import count, read
from impactlaw.stepping.time_stepping.compiled.impulses.sums import add_collision
from impactlaw.stepping.time_stepping.compiled.state.hook import BEGIN, ERROR, HOOK, KEEP, hooked, notify, tell
from impactlaw.stepping.time_stepping.compiled.state.kinds import (
    BOOLEAN,
    INTEGER,
    LAW,
    MARKS,
    NUMBERS,
    ROOM,
    WORLD,
    typeof,
)
from impactlaw.stepping.time_stepping.compiled.state.room import SUMS, answer_at, rows_at, velocities_at
from impactlaw.stepping.time_stepping.compiled.state.status import FINE
from impactlaw.stepping.time_stepping.compiled.state.surfaces import surfaces_move
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, metric_of, setting
from impactlaw.stepping.time_stepping.problem.energy import add_before
from impactlaw.stepping.time_stepping.problem.gradient_turns import write_recalled
from impactlaw.stepping.time_stepping.problem.rows import JACOBIAN, KNOWN
from impactlaw.stepping.time_stepping.problem.targets import write_closing


class Outcome(NamedTuple):
    """The effect of contact in a step; rows and impulses are in the room of the step, see `state.room`."""

    groups: int  # number of groups that take part
    rows: int  # number of their rows
    solved: Solved  # properties of the solution
    # whether restitution is lost: contacts that are hit only through others were not given a phase of their own, bodies
    # jam, the law found no impulses, no work was left to find how much restitution creates no energy, or contacts are
    # left out that the resulting velocity would close
    later: bool


@once
def _resolve(w, rows, metric, start, free, known, rounds, law, answer, sums):
    """Find the impulses of all contacts at once; the result is like that of `resolve_in_phases`."""
    answer.may[:] = True
    solved = solve(w, rows, metric, start, known, rounds, law, answer, False)
    cut = solved.status == FINE and goes_on(w, rows, solved, answer)
    if scalable(w, solved):
        solved = solve(w, rows, metric, start, known, rounds, law, answer, True)
    if solved.status != FINE:
        return solved, False
    cut = cut or lost(w, solved)
    if setting(w, SETTING.sums) != 0.0:
        clear(sums)
        if solved.collided:
            add_collision(w, rows, answer, solved.share, solved.created, metric, start, sums)
    if solved.collided and hooked(w, HOOK.keeps):
        if tell(w, KEEP, rows, answer, start, free, solved.share, solved.created, 0) == ERROR:
            return STOPPED, False
    velocity = velocity_of(w)
    for i in range(w.nv):
        velocity[i] = free[i] + answer.change[i]
    return solved, cut


@linked(
    typeof(Outcome(0, 0, NO_ANSWER, False))(WORLD, JACOBIAN, MARKS, *[NUMBERS] * 3, KNOWN, INTEGER, LAW, BOOLEAN, ROOM),
    counts=False,
)
def attempt(w, jacobian, chosen, start, moved, free, known, rounds, law, phases, room):
    """Solve the problem of the rows that are near, set the velocity after it, and return the effect of contact.

    Args:
        w: the world in the middle of the step.
        jacobian: `access.jacobian_of`, without zeros.
        chosen: the rows, bool (nefc,).
        start: velocity at the start, (nv,).
        moved: velocity added to it before a collision, (nv,), see `inertial_forces`; (0,) to add nothing.
        free: velocity without contact, (nv,).
        known: see `rows.Known`.
        rounds: rounds of the slower solvers.
        law: see `law`.
        phases: whether contacts may collide one after another.
        room: see `state.room`; rows, answer and, if they are asked for, sums over the collisions are written to it.
    """
    frictional = setting(w, SETTING.frictional) != 0.0
    if hooked(w, HOOK.keeps) and notify(w, BEGIN) == ERROR:
        return Outcome(0, 0, STOPPED, False)
    groups, many = count(w, chosen, frictional)
    if many == 0:
        return Outcome(groups, many, NO_ANSWER, False)
    metric, velocity = metric_of(w), row_floats(w, DATA.efc_vel)
    rows, answer = rows_at(room.rows, groups, many, room.entries), answer_at(room.answer, groups, many, w.nv)
    read(w, jacobian, metric, velocity, start, free, chosen, frictional, rows)
    write_recalled(rows, known)
    if surfaces_move(w):
        add_surfaces(w, rows)
    before, sums = start, floats(room.sums, SUMS)
    if len(moved) > 0:
        before = velocities_at(room, 9, 1)
        for i in range(w.nv):
            before[i] = start[i] + moved[i]
        add_before(rows, jacobian, moved)
        if not phases:  # the answer is that of the last attempt, with the same rows
            write_closing(rows, w.timestep, answer.collides)
    if phases:
        solved, cut = resolve_in_phases(w, rows, metric, before, free, known, rounds, law, answer, sums)
    else:
        solved, cut = _resolve(w, rows, metric, before, free, known, rounds, law, answer, sums)
    return Outcome(groups, many, solved, cut)


@plain
def sees_more(chosen, seen):
    """Return whether any row is seen that is not chosen yet."""
    for i in range(len(seen)):
        if seen[i] and not chosen[i]:
            return True
    return False
