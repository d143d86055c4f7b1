"""The targets of the contacts of one phase in compiled code, and the answer of `resolve_step`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw.solvers.cones import BILATERAL
from impactlaw.solvers.cones.algebra.loops import counts, kernel, plain
from impactlaw.stepping.compiled.access import data_ints, model_ints, number, size
from impactlaw.stepping.compiled.fields import DATA, MODEL, flags, floats
from impactlaw.stepping.time_stepping.compiled.state.kinds import typeof
from impactlaw.stepping.time_stepping.compiled.state.law import ask_law, reverse
from impactlaw.stepping.time_stepping.compiled.state.status import CREATES, FINE, NOT_FINITE
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.drifting_equalities import hold_constraints
from impactlaw.stepping.time_stepping.problem.gradient_turns import write_sliding
from impactlaw.stepping.time_stepping.problem.phases import find_later
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import Aims, Method
from impactlaw.stepping.time_stepping.problem.solution.resolve import resolve
from impactlaw.stepping.time_stepping.problem.targets import aim, close_gaps
from impactlaw.stepping.time_stepping.tolerances import RESOLVED

_APART = np.bool_(False)  # laws in compiled code couple only contacts that influence each other


class Solved(NamedTuple):
    """Properties of a solution; see `resolve.resolve_step`."""

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


NO_ANSWER = Solved(False, False, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, FINE, 0.0)
SOLVED = typeof(NO_ANSWER)


@kernel
def _stiffen(w, rows, tree, collides, bound):
    """Make equality constraints keep their velocity in a collision, unless they drift too fast.

    Write which constraints must not drive the collision, bool (g,).
    """
    number_of, known = data_ints(w, DATA.efc_id, number(w, DATA.nefc)), flags(w.bilateral, size(w, MODEL.neq))
    kinds = counts(len(bound))
    for g in range(len(bound)):
        if rows.groups[2, g] == BILATERAL:
            kinds[g] = known[number_of[rows.sparse[2, rows.groups[0, g]]]]
        bound[g] = kinds[g] != 0
    hold_constraints(rows, collides, kinds, tree)


@plain
def _collide(w, rows, tree, law, answer):
    """Set the law's targets, keep closed contacts closed, and make equality constraints keep their velocity.

    Return `status.FINE`, or what has gone wrong.
    """
    status, reversal = FINE, setting(w, SETTING.reversal)
    if not np.isnan(reversal):
        reverse(reversal, rows, tree, answer.collides, answer.target)
    elif np.isnan(setting(w, SETTING.restitution)):
        status = ask_law(law, rows, answer.collides, answer.target)
    close_gaps(rows, tree, answer.collides, answer.target)
    _stiffen(w, rows, tree, answer.collides, answer.bound)
    return status


@plain
def solve(w, rows, metric, known, rounds, law, answer, scaled):
    """Solve the problem of these rows; groups may collide according to the answer, whose other fields are written.

    If restitution is to be `scaled`, it creates no energy, or the status is an error.
    """
    tree, e = model_ints(w, MODEL.dof_treeid, w.nv), setting(w, SETTING.restitution)
    status, sliding = FINE, 0.0
    resolved = RESOLVED * setting(w, SETTING.meter)
    collided = aim(
        rows.groups, rows.key, rows.amounts, rows.rates, w.timestep, 0.0 if np.isnan(e) else e,
        setting(w, SETTING.rest_speed), resolved, answer.may, answer.target, answer.collides,
    )  # fmt: skip
    answer.bound[:] = False
    if collided:
        status, sliding = _collide(w, rows, tree, law, answer), setting(w, SETTING.sliding)
    if status != FINE:
        return Solved(collided, False, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, status, 0.0)
    for r in range(len(answer.sliding)):
        answer.sliding[r] = -sliding * rows.rates[1, r] if sliding != 0.0 else 0.0
    if not collided:
        write_sliding(rows.groups, rows.rates, resolved, answer.sliding)
    aims = Aims(answer.target, answer.sliding, answer.collides)
    project = scaled and setting(w, SETTING.dissipative) > 0.0
    method = Method(tree, setting(w, SETTING.exact) != 0.0, rounds, floats(w.work, 1))
    opens, missed, fastest, share, created, work, rounding, residual = resolve(
        rows, aims, answer.bound, known[:4], w.timestep, project, _APART, method, metric,
        answer.x, answer.change, answer.shift, answer.reached, answer.z,
    )  # fmt: skip
    if not np.isfinite(missed):
        status = NOT_FINITE
    elif scaled and created > 0.0 and setting(w, SETTING.dissipative) < 0.0:
        status = CREATES
    return Solved(collided, opens, missed, fastest, share, created, work, rounding, status, residual)


@plain
def goes_on(w, rows, solved, answer):
    """Write which contacts are hit only through others; return whether there are any whose restitution is lost."""
    if not solved.collided or setting(w, SETTING.restitution) == 0.0:
        return False
    slowest, resolved = setting(w, SETTING.rest_speed), RESOLVED * setting(w, SETTING.meter)
    return find_later(rows, answer.z, answer.x, answer.collides, slowest, resolved, answer.later)


@plain
def scalable(w, solved):
    """Return whether restitution creates energy, which must be scaled away or is an error."""
    return solved.created > 0.0 and setting(w, SETTING.dissipative) != 0.0


@plain
def lost(w, solved):
    """Return whether restitution is given up: bodies jam, or no work was left to find what creates no energy."""
    return solved.share == 0.0 or solved.created > 0.0 >= floats(w.work, 1)[0]
