"""Collisions one after another within a step; see `problem.phases`."""

from __future__ import annotations

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import any_of, clear, copied, numbers, once, put, zeros
from impactlaw.stepping.compiled.access import model_ints, velocity_of
from impactlaw.stepping.compiled.fields import MODEL, address_of, floats, keep
from impactlaw.stepping.compiled.whitening import INERTIA
from impactlaw.stepping.time_stepping.compiled.impulses.answer import (
    SOLVED,
    STOPPED,
    Solved,
    goes_on,
    lost,
    scalable,
    solve,
)
from impactlaw.stepping.time_stepping.compiled.impulses.sums import add_collision
from impactlaw.stepping.time_stepping.compiled.state.hook import ERROR, HOOK, KEEP, hooked, tell
from impactlaw.stepping.time_stepping.compiled.state.kinds import ANSWER, BOOLEAN, INTEGER, LAW, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.room import answer_at, answer_size
from impactlaw.stepping.time_stepping.compiled.state.status import FINE
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.energy import is_met
from impactlaw.stepping.time_stepping.problem.phases import later_rates, reached_by, some_groups
from impactlaw.stepping.time_stepping.problem.rows import KNOWN, ROWS, Known, Rows
from impactlaw.stepping.time_stepping.problem.solution.scaling import RESERVE
from impactlaw.stepping.time_stepping.tolerances import FEW_ROUNDS, PHASES


@once
def _meet(w, rows, metric, before, velocity, known, rounds, law, may, more, block, sums):
    """Solve one phase, and solve it again without the contacts that are hit only through others.

    Return the properties of the solution, the answer, the index of each of its rows, (n,), the groups that are left
    out, bool (g,), and whether some contacts that are hit only through others were not left out.

    ``before`` and ``velocity``, (nv,), are the velocity before the collision, and the one that it changes; `more` says
    whether contacts may be left out.
    """
    later, place, part, allowed = np.zeros(len(may), np.bool_), np.arange(len(rows.rates[0])), rows, may
    while True:
        answer = answer_at(address_of(block), len(part.key), len(part.rates[0]), w.nv)
        put(answer.may, allowed)
        solved = solve(w, part, metric, before, known, rounds, law, answer, False)
        waiting = solved.status == FINE and goes_on(w, part, solved, answer)
        if not more or floats(w.work, 1)[0] <= RESERVE or not waiting or not is_met(solved.missed, solved.fastest):
            if scalable(w, solved):
                solved = solve(w, part, metric, before, known, rounds, law, answer, True)
            break
        k = 0
        for g in range(len(later)):
            if not later[g]:
                later[g], k = answer.later[k], k + 1
        kept = ~later
        known, rounds = Known(part.groups, part.key, part.rates[0], answer.x.copy(), part.rates[5:]), FEW_ROUNDS
        part, place = some_groups(rows, kept)
        allowed = may[kept]
    if solved.status == FINE and solved.collided and setting(w, SETTING.sums) != 0.0:
        add_collision(w, part, answer, solved.share, solved.created, metric, before, sums)
    if solved.status == FINE and solved.collided and hooked(w, HOOK.keeps):
        if tell(w, KEEP, part, answer, before, velocity, solved.share, solved.created, 0) == ERROR:
            solved = STOPPED
    return solved, answer, place, later, waiting


@linked(types.Tuple((SOLVED, BOOLEAN))(WORLD, ROWS, INERTIA, NUMBERS, NUMBERS, KNOWN, INTEGER, LAW, ANSWER, NUMBERS))
def resolve_in_phases(w, rows, metric, start, free, known, rounds, law, whole, sums):
    """Find the impulses, phase by phase.

    Contacts that are hit only through others, across an open gap, are left out first, and collide starting from the
    velocity after the collision of the others. There are at most `PHASES` phases, as long as more work than `RESERVE`
    is left, and no phase follows one whose problem was not solved. In the last phase such a contact is merely kept from
    penetrating. Restitution is scaled so that it creates no energy only when no contact is left out any more: the
    reserved work is for that.

    Impulses and the velocity that opens overlaps are written to the answer, and the velocity after the step to data.
    Return the properties of the solution, and whether contacts that are hit only through others were not given a phase
    of their own.
    """
    now, n = rows, len(rows.rates[0])
    place, may, x, velocity = np.arange(n), np.ones(len(rows.key), np.bool_), zeros(n), copied(free)
    missed, fastest, share, created, work, rounding, residual = 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0
    collided = opens = False
    more, cut, before, moved = True, False, start, numbers(w.nv)
    block = np.empty(answer_size(len(rows.key), n, w.nv))
    clear(sums)
    for phase in range(PHASES):
        solved, met, where, later, waiting = _meet(
            w, now, metric, before, velocity, known, rounds if phase == 0 else FEW_ROUNDS, law, may,
            more and phase < PHASES - 1, block, sums,
        )  # fmt: skip
        more, cut = more and is_met(solved.missed, solved.fastest), cut or waiting or lost(w, solved)
        collided, created, opens = collided or solved.collided, created + solved.created, solved.opens
        if solved.status != FINE:
            return Solved(collided, False, 0.0, 0.0, 1.0, created, 0.0, 0.0, solved.status, 0.0, False), cut
        for r in range(len(where)):
            x[place[where[r]]] += met.x[r]
        for i in range(w.nv):
            velocity[i] += met.change[i]
        put(whole.shift, met.shift)
        missed, fastest, share = max(missed, solved.missed), max(fastest, solved.fastest), min(share, solved.share)
        work, rounding, residual = work + solved.work, rounding + solved.rounding, max(residual, solved.residual)
        if not any_of(later):
            break
        reached, rates = reached_by(now, model_ints(w, MODEL.dof_treeid, w.nv), later), later_rates(now, met.z)
        after = Rows(now.sparse, now.colind, now.value, now.groups, now.key, now.amounts, rates)
        now, chosen = some_groups(after, reached)
        for r in range(len(chosen)):  # the indices are ascending
            place[r] = place[chosen[r]]
        place, may, before = place[: len(chosen)], later[reached], moved
        for i in range(w.nv):
            moved[i] = start[i] + (velocity[i] - free[i])
    put(whole.x, x)
    whole.reached[:] = np.nan
    keep(block)
    put(velocity_of(w), velocity)
    return Solved(collided, opens, missed, fastest, share, created, work, rounding, FINE, residual, False), cut
