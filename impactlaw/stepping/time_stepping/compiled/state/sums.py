"""Sums over the collisions of a compiled step, equal to those over its events; see `events.CollisionRecord`.

A collision alone starts at v- and contains no forces, so that its problem is solved again. Couplings of joints and
tendons keep their velocity in it. If this does not suffice, because surfaces move, connects or welds take part,
couplings drive the collision, or the outcome is not in S(v-), the sums need events.
"""

from __future__ import annotations

import numpy as np

from impactlaw.mechanics.tolerances import SIGNIFICANT
from impactlaw.scene.equality_constraints import TYING
from impactlaw.solvers.cones import BILATERAL, CONE
from impactlaw.solvers.cones.algebra.loops import (
    any_of,
    cleared,
    counts,
    indices,
    integers,
    kernel,
    norm,
    numbers,
    once,
    plain,
    zeros,
)
from impactlaw.solvers.cones.solve import linked_improve
from impactlaw.stepping.compiled.access import data_ints, model_ints, number, size
from impactlaw.stepping.compiled.fields import DATA, MODEL, flags
from impactlaw.stepping.compiled.whitening import whitened
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.energy import find_islands
from impactlaw.stepping.time_stepping.problem.targets import reached_groups
from impactlaw.stepping.time_stepping.tolerances import DRIVEN

COUNT, ENERGY, SURFACE, INTENSITY, DISTANT, INADMISSIBLE = 0, 1, 2, 3, 4, 5
"""Indices of the sums: number of collisions, T+ - T-, work of drifted couplings in it, |v+ - v-|, and number of
collisions with a distant effect, and with scaled restitution.
"""
SUMS = 6

_TOLERANCE, _ENOUGH, _ROUNDS = 1e-13, 1e-10, np.int64(24)
_DRIFT = 1e-10  # largest difference of a row's velocity from J v, relative to the row's part of |v-|
_ROUNDING = 5e-13  # energy that counts as rounding, relative to |v-|^2
_OUTSIDE = 1e-10  # part of |v-| by which an outcome may leave S(v-)


@once
def _aims(rows, members, v, speed, target, sliding, b):
    """Write the offsets of the rows that take part; return whether their velocities are due to v alone."""
    for g in members:
        first = rows.groups[0, g]
        for r in range(first, first + rows.groups[1, g]):
            own, square, scale = 0.0, 0.0, rows.rates[0, r]
            for a in range(rows.sparse[1, r], rows.sparse[1, r] + rows.sparse[0, r]):
                own += rows.value[a] * v[rows.colind[a]]
                square += rows.value[a] * rows.value[a]
            before = scale * rows.rates[1, r]
            if abs(before - own) > _DRIFT * speed * np.sqrt(square):
                return False
            if rows.groups[2, g] == CONE:
                b[r] = before - (target[g] if r == first else scale * sliding[r])
    return True


@plain
def _list(groups, reached, members, firsts, sizes, kinds):
    """Write the groups that are reached, with their first rows, sizes and kinds."""
    at = 0
    for g in range(len(reached)):
        if reached[g]:
            members[at], firsts[at], sizes[at], kinds[at] = g, groups[0, g], groups[1, g], groups[2, g]
            at += 1


@kernel
def _ties(w, rows, bound):
    """Return whether connects or welds must keep their velocity in a collision: not all of their rows may count."""
    known, number_of = flags(w.bilateral, size(w, MODEL.neq)), data_ints(w, DATA.efc_id, number(w, DATA.nefc))
    some = False
    for g in range(len(bound)):
        some = some or (bound[g] and known[number_of[rows.sparse[2, rows.groups[0, g]]]] == TYING)
    return some


@kernel
def add_collision(w, rows, answer, share, metric, velocity, sums):
    """Add a collision of a phase to the sums, (`SUMS`,); NaN if its event is needed.

    Args:
        w: the world.
        rows: rows of the phase.
        answer: see `room.Answer`.
        share: share of the law's restitution that is kept.
        metric: the mass matrix of the step.
        velocity: v-, (nv,).
        sums: see `COUNT`, written.
    """
    tree, n = model_ints(w, MODEL.dof_treeid, w.nv), len(answer.x)
    pushed, target, many = cleared(len(rows.key)), numbers(len(rows.key)), 0
    for g in range(len(pushed)):
        target[g] = answer.reached[g] if answer.collides[g] else 0.0
        pushed[g] = answer.x[rows.groups[0, g]] > 0.0
    if _ties(w, rows, answer.bound):
        sums[COUNT] = np.nan
        return
    reached = reached_groups(rows, tree, answer.collides, pushed)
    for g in range(len(reached)):
        reached[g] = reached[g] or answer.bound[g]
        many += reached[g]
    members, firsts, sizes, kinds = indices(many), integers(many), integers(many), integers(many)
    _list(rows.groups, reached, members, firsts, sizes, kinds)
    root, v = numbers(w.nv), numbers(w.nv)
    for i in range(w.nv):
        root[i] = np.sqrt(metric.inverse[i])
    whitened(velocity, metric, root, v)
    b = zeros(n)
    if not _aims(rows, members, v, norm(v), target, answer.sliding, b):
        sums[COUNT] = np.nan
        return
    x, z, left = zeros(n), numbers(w.nv), zeros(1)
    left[0] = 1.0
    for g in members:  # of several solutions, the one that the step took
        for r in range(rows.groups[0, g], rows.groups[0, g] + rows.groups[1, g]):
            x[r] = answer.x[r]
    residual, _ = linked_improve(
        rows.sparse[0], rows.sparse[1], rows.colind, rows.value, tree, firsts, sizes, kinds, zeros(many),
        zeros(n), b, setting(w, SETTING.exact) != 0.0, _TOLERANCE, _ROUNDS, left, x, z,
    )  # fmt: skip
    if not residual <= _ENOUGH:
        sums[COUNT] = np.nan
    _book(rows, members, tree, answer.bound, x, z, norm(v), sums)
    sums[INADMISSIBLE] += share < 1.0


@once
def _book(rows, members, tree, bound, x, z, speed, sums):
    """Add the properties of a collision to the sums; NaN if its outcome is not in S(v-), or couplings drive it."""
    label, distant, intensity, count = counts(len(rows.key)), False, norm(z), 0
    if any_of(bound):
        count = find_islands(rows, tree, label)
    work, own, energy = zeros(count + 1), zeros(count + 1), numbers(count + 1)  # the last one of what cannot move
    energy[:] = _ROUNDING * speed * speed
    for g in members:
        first, i = rows.groups[0, g], label[g]
        for r in range(first, first + rows.groups[1, g]):
            before = rows.rates[0, r] * rows.rates[1, r]
            changed, length = 0.0, 0.0
            for a in range(rows.sparse[1, r], rows.sparse[1, r] + rows.sparse[0, r]):
                changed += rows.value[a] * z[rows.colind[a]]
                length += rows.value[a] * rows.value[a]
            mean, length = before + 0.5 * changed, np.sqrt(length)
            work[i] += x[r] * mean
            if rows.groups[2, g] == BILATERAL:
                own[i] += x[r] * mean
            elif r == first:
                distant = distant or (x[r] * length > SIGNIFICANT * speed and mean > SIGNIFICANT * speed * length)
                energy[i] = max(energy[i], 0.5 * (before / length) ** 2 if length > 0.0 else 0.0)
                if before + changed < -_OUTSIDE * speed * length:
                    sums[COUNT] = np.nan
    for i in range(count):  # as in `events._driven_islands`
        if min(own[i], work[i]) > DRIVEN * energy[i]:
            sums[COUNT] = np.nan
    if 2.0 * work.sum() > _OUTSIDE * max(speed, intensity) ** 2:
        sums[COUNT] = np.nan
    sums[COUNT] += 1.0
    sums[ENERGY] += work.sum()
    sums[SURFACE] += own.sum()
    sums[INTENSITY] += intensity
    sums[DISTANT] += distant
