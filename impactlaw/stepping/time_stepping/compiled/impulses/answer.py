"""The targets of the contacts of one phase, and the answer of `resolve`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw.linked import linked
from impactlaw.solvers.cones import BILATERAL
from impactlaw.solvers.cones.algebra.loops import counts, kernel, plain
from impactlaw.stepping.compiled.access import model_ints, row_ints, size
from impactlaw.stepping.compiled.fields import DATA, MODEL, flags, floats
from impactlaw.stepping.compiled.whitening import INERTIA
from impactlaw.stepping.time_stepping.compiled.state.hook import ASK, ERROR, HOOK, LOST, TOGETHER, WATCH, hooked, tell
from impactlaw.stepping.time_stepping.compiled.state.kinds import ANSWER, BOOLEAN, INTEGER, LAW, NUMBERS, WORLD, typeof
from impactlaw.stepping.time_stepping.compiled.state.law import add_reached, ask_law, reverse
from impactlaw.stepping.time_stepping.compiled.state.status import CREATES, FINE, NOT_FINITE, RAISED
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.drifting_equalities import hold_constraints
from impactlaw.stepping.time_stepping.problem.gradient_turns import write_sliding
from impactlaw.stepping.time_stepping.problem.phases import find_later
from impactlaw.stepping.time_stepping.problem.rows import KNOWN, ROWS
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import Aims, Method, guess
from impactlaw.stepping.time_stepping.problem.solution.resolve import resolve
from impactlaw.stepping.time_stepping.problem.targets import aim, close_gaps
from impactlaw.stepping.time_stepping.tolerances import RESOLVED


class Solved(NamedTuple):
    """Properties of a solution; see `resolve.resolve`."""

    collided: bool  # whether any contact collides
    opens: bool  # whether there are overlaps to open
    missed: float  # largest amount by which a contact velocity misses its target, m/s or rad/s
    fastest: float  # largest velocity of a row, m/s or rad/s
    share: float  # smallest share of restitution that is kept
    created: float  # energy that the law would create without scaling, J
    work: float  # work of contact, J
    rounding: float  # part of the work that is rounding, J
    status: int  # see `status`
    residual: float  # residual of the natural map, including friction, relative to the largest velocity
    lost: bool  # whether a law that is asked in Python has found no impulses


NO_ANSWER = Solved(False, False, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, FINE, 0.0, False)
STOPPED = NO_ANSWER._replace(status=RAISED)
SOLVED = typeof(NO_ANSWER)


@kernel
def _stiffen(w, rows, tree, collides, bound):
    """Make equality constraints keep their velocity in a collision, unless they drift too fast.

    Write which constraints must not drive the collision, bool (g,).
    """
    number_of, known = row_ints(w, DATA.efc_id), flags(w.bilateral, size(w, MODEL.neq))
    kinds = counts(len(bound))
    for g in range(len(bound)):
        if rows.groups[2, g] == BILATERAL:
            kinds[g] = known[number_of[rows.sparse[2, rows.groups[0, g]]]]
        bound[g] = kinds[g] != 0
    hold_constraints(rows, collides, kinds, tree)


@plain
def _collide(w, rows, tree, law, before, answer):
    """Make equality constraints keep their velocity, set the law's targets, and keep closed contacts closed.

    Return `status.FINE`, or what has gone wrong, and the reply of a law that is asked in Python.
    """
    status, reply, reversal, asks = FINE, 0, setting(w, SETTING.reversal), setting(w, SETTING.asks)
    if asks > 1.0 or not np.isnan(reversal):
        add_reached(rows, tree, answer.collides)
    _stiffen(w, rows, tree, answer.collides, answer.bound)
    if asks > 0.0:
        reply = tell(w, ASK, rows, answer, before, before, 1.0, 0.0, 0)
        if reply == ERROR:
            return RAISED, 0
    elif not np.isnan(reversal):
        reverse(reversal, rows, w.nv, answer.collides, answer.target)
    elif np.isnan(setting(w, SETTING.restitution)):
        status = ask_law(law, rows, answer.collides, answer.target)
    close_gaps(rows, tree, answer.collides, answer.target)
    return status, reply


@plain
def _slowest(w):
    return setting(w, SETTING.rest_speed), setting(w, SETTING.rest_turn)


@linked(SOLVED(WORLD, ROWS, INERTIA, NUMBERS, KNOWN, INTEGER, LAW, ANSWER, BOOLEAN))
def solve(w, rows, metric, before, known, rounds, law, answer, scaled):
    """Solve the problem of these rows; groups may collide according to the answer, whose other fields are written.

    If restitution is to be `scaled`, it creates no energy, or the status is an error. ``before``, (nv,), is the
    velocity before a collision.
    """
    tree, e = model_ints(w, MODEL.dof_treeid, w.nv), setting(w, SETTING.restitution)
    status, reply = FINE, 0
    resolved = RESOLVED * setting(w, SETTING.meter)
    collided = aim(
        rows, w.timestep, 0.0 if np.isnan(e) else e, _slowest(w), resolved, answer.may,
        answer.target, answer.collides,
    )  # fmt: skip
    answer.bound[:] = False
    sliding = setting(w, SETTING.sliding) if collided else 0.0
    for r in range(len(answer.sliding)):
        answer.sliding[r] = -sliding * rows.rates[1, r] if sliding != 0.0 else 0.0
    if collided:
        status, reply = _collide(w, rows, tree, law, before, answer)
    else:
        write_sliding(rows.groups, rows.rates, resolved, answer.sliding)
    if status != FINE:
        return Solved(collided, False, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, status, 0.0, False)
    if hooked(w, HOOK.watches):
        guess(rows, known, answer.x)
        if tell(w, WATCH, rows, answer, before, before, 1.0, 0.0, rounds) == ERROR:
            return STOPPED
    aims = Aims(answer.target, answer.sliding, answer.collides)
    project = scaled and setting(w, SETTING.dissipative) > 0.0
    method = Method(tree, setting(w, SETTING.exact) != 0.0, rounds, floats(w.work, 1))
    opens, missed, fastest, share, created, work, rounding, residual = resolve(
        rows, aims, answer.bound, known, w.timestep, project, reply & TOGETHER != 0, method, metric,
        answer.x, answer.change, answer.shift, answer.reached, answer.z,
    )  # fmt: skip
    if not np.isfinite(missed):
        status = NOT_FINITE
    elif scaled and created > 0.0 and setting(w, SETTING.dissipative) < 0.0:
        status = CREATES
    lost = reply & LOST != 0
    return Solved(collided, opens, missed, fastest, share, created, work, rounding, status, residual, lost)


@plain
def goes_on(w, rows, solved, answer):
    """Write which contacts are hit only through others; return whether there are any whose restitution is lost."""
    if not solved.collided or setting(w, SETTING.restitution) == 0.0:
        return False
    slowest, resolved = _slowest(w), RESOLVED * setting(w, SETTING.meter)
    return find_later(rows, answer.z, answer.x, answer.collides, slowest, resolved, answer.later)


@plain
def scalable(w, solved):
    """Return whether restitution creates energy, which must be scaled away or is an error."""
    return solved.created > 0.0 and setting(w, SETTING.dissipative) != 0.0


@plain
def lost(w, solved):
    """Return whether restitution is given up.

    It is if bodies jam, no work was left to find what creates no energy, or the law has found no impulses.
    """
    return solved.share == 0.0 or solved.created > 0.0 >= floats(w.work, 1)[0] or solved.lost
