"""The problem of a step in compiled code: rows of MuJoCo's arrays, targets of the law, and what `resolve_step` says."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from impactlaw.solvers.cones import BILATERAL
from impactlaw.solvers.cones.algebra.loops import kernel, once
from impactlaw.stepping.compiled.access import (
    contact_floats,
    contact_ints,
    data_floats,
    data_ints,
    layout_of,
    model_ints,
    number,
    size,
    velocity_of,
)
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, flags, put
from impactlaw.stepping.time_stepping.compiled.law import ask_law, reverse
from impactlaw.stepping.time_stepping.compiled.state.status import CREATES, FINE, NOT_FINITE
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, metric_of, setting
from impactlaw.stepping.time_stepping.compiled.sums import SUMS, add_collision
from impactlaw.stepping.time_stepping.compiled.surfaces import add_surfaces, surfaces_move
from impactlaw.stepping.time_stepping.problem.contact_problem import linked_step
from impactlaw.stepping.time_stepping.problem.phases import later_rates, reached_by, some_groups, struck_later
from impactlaw.stepping.time_stepping.problem.rows import Rows, near_rows, read_rows
from impactlaw.stepping.time_stepping.problem.targets import close_gaps, contact_targets
from impactlaw.stepping.time_stepping.tolerances import FEW_ROUNDS, PHASE_ROWS, PHASES, RESOLVED, STIFF

Array = np.ndarray[Any, Any]


class Outcome(NamedTuple):
    """What contact does in a step.

    Attributes:
        rows: of the step.
        x: impulses of rows, in units of the problem, (n,).
        shift: velocity that opens overlaps, (nv,), or (0,).
        collided: whether some contact collides.
        missed: largest amount by which a contact velocity misses its target, m/s or rad/s.
        fastest: largest velocity of a row, m/s or rad/s.
        created: energy that the law would create, J.
        work: of contact, J.
        rounding: what of it is rounding, J.
        later: whether contacts that are hit only through others were not left for a phase of their own.
        sums: over the collisions, see `sums`, if they are asked for, else (0,).
        status: see `status`.
    """

    rows: Rows
    x: Array
    shift: Array
    collided: bool
    missed: float
    fastest: float
    created: float
    work: float
    rounding: float
    later: bool
    sums: Array
    status: int


@kernel
def near(w, jacobian, one, other, reach):
    """Return which rows begin a contact or limit that is in touch, or would be soon; see `rows.near_rows`."""
    n, (nnz, adr, col, J) = number(w, DATA.nefc), jacobian
    if surfaces_move(w):  # what comes near need not move itself
        return np.ones(n, np.bool_)
    kinds, position = data_ints(w, DATA.efc_type, n), data_floats(w, DATA.efc_pos, n)
    return near_rows(
        kinds, position, nnz, adr, col, J, contact_ints(w, CONTACT.efc_address, 1)[:, 0], one, other, reach
    )


@kernel
def rows_of_step(w, jacobian, metric, velocity, start, free, chosen, frictional):
    """Return the rows of the groups that are chosen; see `rows.read_rows`.

    Args:
        w: the world, contacts current.
        jacobian: `access.nonzeros_of`.
        metric: L and 1 / D.
        velocity: of MuJoCo's rows, with that of belts, (nefc,); (0,) to leave belts out.
        start: velocity at the start, (nv,).
        free: velocity without contact, (nv,).
        chosen: of MuJoCo's rows, bool (nefc,).
        frictional: whether rows of friction take part.
    """
    n, (nnz, adr, col, J), (factor, inverse) = number(w, DATA.nefc), jacobian, metric
    Mnnz, Madr, Mcol = layout_of(w)
    trees = size(w, MODEL.ntree)
    return Rows(
        *read_rows(
            data_ints(w, DATA.efc_type, n), data_ints(w, DATA.efc_id, n), data_floats(w, DATA.efc_pos, n), velocity,
            data_floats(w, DATA.efc_aref, n), data_floats(w, DATA.efc_R, n), data_floats(w, DATA.efc_frictionloss, n),
            nnz, adr, col, J,
            contact_ints(w, CONTACT.efc_address, 1)[:, 0], contact_ints(w, CONTACT.dim, 1)[:, 0],
            contact_ints(w, CONTACT.geom, 2), contact_floats(w, CONTACT.friction, 5),
            Mnnz, Madr, Mcol, factor, inverse,
            model_ints(w, MODEL.dof_treeid, w.nv), model_ints(w, MODEL.tree_dofadr, trees),
            model_ints(w, MODEL.tree_dofnum, trees),
            start, free, chosen, w.timestep, frictional,
        )
    )  # fmt: skip


@kernel
def _nothing():
    """Return what contact does where there is none."""
    table, no, few = np.empty((3, 0), np.int32), np.empty(0), np.empty(0, np.int32)
    groups, amounts, rates = np.empty((4, 0), np.int32), np.empty((2, 0)), np.empty((5, 0))
    rows = Rows(table, few, no, groups, np.empty(0, np.int64), amounts, rates)
    return Outcome(rows, no, no, False, 0.0, 0.0, 0.0, 0.0, 0.0, False, no, FINE)


class _Answer(NamedTuple):
    """What the contacts of a phase do; see `Outcome` and `contact_problem.resolve_step`."""

    x: Array
    change: Array
    shift: Array
    collides: Array
    target: Array
    sliding: Array
    share: float
    missed: float
    fastest: float
    created: float
    work: float
    rounding: float
    z: Array
    status: int


@once
def _collide(w, rows, tree, collides, target):
    """Let contacts in touch stay closed, and equality constraints keep their velocity."""
    close_gaps(rows.groups, rows.sparse, rows.colind, rows.amounts, rows.rates, tree, collides, target)
    n = number(w, DATA.nefc)
    number_of, compliance = data_ints(w, DATA.efc_id, n), data_floats(w, DATA.efc_R, n)
    for g in range(len(target)):
        row = rows.groups[0, g]
        place = rows.sparse[2, row]
        if rows.groups[2, g] == BILATERAL and flags(w.bilateral, size(w, MODEL.neq))[number_of[place]]:
            rows.rates[4, row] = STIFF * compliance[place]


@once
def _solve(w, rows, metric, known, rounds, law, may):
    """Solve the problem of these rows, in which some groups may collide."""
    n, tree, (factor, inverse) = len(rows.rates[0]), model_ints(w, MODEL.dof_treeid, w.nv), metric
    e = setting(w, SETTING.restitution)
    target, collides = contact_targets(
        rows.groups, rows.amounts, rows.rates, w.timestep, 0.0 if np.isnan(e) else e, setting(w, SETTING.rest_speed),
        RESOLVED, may,
    )  # fmt: skip
    collided, status = collides.any(), FINE
    if collided:
        if not np.isnan(setting(w, SETTING.reversal)):
            reverse(setting(w, SETTING.reversal), rows, tree, collides, target)
        elif np.isnan(e):
            status = ask_law(law, rows, tree, collides, target)
        _collide(w, rows, tree, collides, target)
    nothing = np.empty(0)
    if status != FINE:
        return _Answer(
            nothing, nothing, nothing, collides, nothing, nothing, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, nothing, status
        )
    sliding, some = np.zeros(n), setting(w, SETTING.sliding)
    if collided and some != 0.0:
        sliding = -some * rows.rates[1]
    known_groups, known_key, known_scale, impulses = known
    Mnnz, Madr, Mcol = layout_of(w)
    x, change, shift, reached, missed, fastest, share, created, work, rounding, z = linked_step(
        rows.sparse, rows.colind, rows.value, rows.groups, rows.key, rows.amounts, rows.rates, target, sliding,
        collides, known_groups, known_key, known_scale, impulses, w.timestep, setting(w, SETTING.exact) != 0.0,
        setting(w, SETTING.dissipative) > 0.0, rounds, tree, factor, inverse, Mnnz, Madr, Mcol,
    )  # fmt: skip
    if not np.isfinite(missed):
        status = NOT_FINITE
    elif created > 0.0 and setting(w, SETTING.dissipative) < 0.0:
        status = CREATES
    return _Answer(
        x, change, shift, collides, reached, sliding, share, missed, fastest, created, work, rounding, z, status
    )


@once
def _meet(w, rows, metric, before, known, rounds, law, may, left, sums):
    """Solve one phase: once, and again without the contacts that are hit only through others.

    Return what is answered, the place of each of its rows, (n,), the groups that are left out, bool (g,), how many rows
    may still be solved for such contacts, and whether some of them were not left out.
    """
    later, place = np.zeros(len(may), np.bool_), np.arange(len(rows.rates[0]))
    part, allowed = rows, may
    while True:
        waiting = False
        met = _solve(w, part, metric, known, rounds, law, allowed)
        if met.status != FINE or setting(w, SETTING.restitution) == 0.0 or not met.collides.any():
            break  # without restitution none is lost
        new = struck_later(
            part.groups, part.sparse, part.colind, part.value, part.amounts, part.rates, met.z, met.x, met.collides,
            setting(w, SETTING.rest_speed), RESOLVED,
        )  # fmt: skip
        waiting = new.any()
        if left <= 0 or not waiting:
            break
        later[np.flatnonzero(~later)] |= new
        known, rounds = (part.groups, part.key, part.rates[0], met.x), FEW_ROUNDS
        part, place = _some(rows, rows.rates, ~later)
        allowed, left = may[~later], left - len(place)
    if len(sums) > 0 and met.status == FINE and met.collides.any():
        add_collision(w, part, met, metric, before, sums)
    return met, place, later, left, waiting


@kernel
def _some(rows, rates, keep):
    """Return some groups, with other rates, and the places of their rows."""
    chosen, place = some_groups(rows.sparse, rows.colind, rows.value, rows.groups, rows.key, rows.amounts, rates, keep)
    return Rows(*chosen), place


@once
def _resolve(w, rows, metric, start, free, known, rounds, law, phases):
    """Find the impulses, phase by phase; see `contact_impulses.ContactProblem.find`."""
    now, n = rows, len(rows.rates[0])
    place, may, x, velocity = np.arange(n), np.ones(len(rows.key), np.bool_), np.zeros(n), free.copy()
    missed, fastest, created, work, rounding, collided, shift = 0.0, 0.0, 0.0, 0.0, 0.0, False, np.empty(0)
    left, cut, before = PHASE_ROWS if phases else 0, False, start
    sums = np.zeros(SUMS if setting(w, SETTING.told) != 0.0 else 0)
    for phase in range(PHASES):
        met, where, later, left, waiting = _meet(
            w, now, metric, before, known, rounds if phase == 0 else FEW_ROUNDS, law, may,
            0 if phase == PHASES - 1 else left, sums,
        )  # fmt: skip
        left, cut = left - len(now.rates[0]), cut or waiting
        collided = collided or met.collides.any()
        created, shift = created + met.created, met.shift
        if met.status != FINE:
            return Outcome(rows, x, shift, collided, 0.0, 0.0, created, 0.0, 0.0, False, sums, met.status)
        for r in range(len(where)):
            x[place[where[r]]] += met.x[r]
        velocity += met.change
        missed, fastest = max(missed, met.missed), max(fastest, met.fastest)
        work, rounding = work + met.work, rounding + met.rounding
        if not later.any():
            break
        keep = reached_by(now.groups, now.sparse, now.colind, model_ints(w, MODEL.dof_treeid, w.nv), later)
        rates = later_rates(now.groups, now.sparse, now.colind, now.value, now.rates, met.z)
        now, chosen = _some(now, rates, keep)
        place, may, before = place[chosen], later[keep], velocity.copy()
    put(velocity_of(w), velocity)
    return Outcome(rows, x, shift, collided, missed, fastest, created, work, rounding, cut, sums, FINE)


@kernel
def attempt(w, jacobian, chosen, start, free, known, rounds, law, phases):
    """Solve the problem of the rows that are near, set the velocity after it, and return what contact does.

    Args:
        w: the world in the middle of the step.
        jacobian: `access.nonzeros_of`.
        chosen: the rows, bool (nefc,).
        start: velocity at the start, (nv,).
        free: velocity without contact, (nv,).
        known: groups, keys, coefficients and impulses of the last step.
        rounds: of the slower solvers.
        law: see `law`.
        phases: whether collisions may be one after another.
    """
    if not chosen.any():
        return _nothing()
    metric, frictional = metric_of(w), setting(w, SETTING.frictional) != 0.0
    row_velocity = data_floats(w, DATA.efc_vel, number(w, DATA.nefc))
    rows = rows_of_step(w, jacobian, metric, row_velocity, start, free, chosen, frictional)
    if surfaces_move(w):
        add_surfaces(w, rows.groups, rows.sparse, rows.rates)
    return _resolve(w, rows, metric, start, free, known, rounds, law, phases)
