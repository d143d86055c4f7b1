"""Sums over the collisions of a compiled step, equal to those over its events; see `events.CollisionRecord`.

A collision alone starts at v- and contains no forces, so that its problem is solved again. Equality constraints keep
their velocity in it. If this does not suffice, because surfaces move, constraints drive the collision, or the outcome
is not in S(v-), the sums need events.
"""

from __future__ import annotations

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.mechanics.tolerances import FIXED, SIGNIFICANT
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import (
    FIRST,
    any_of,
    clear,
    cleared,
    counts,
    dot,
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
from impactlaw.stepping.compiled.access import jacobian_of, model_ints, number, row_floats, row_ints, size
from impactlaw.stepping.compiled.fields import DATA, MODEL, flags
from impactlaw.stepping.compiled.left_out.constraint_basis import least_length, orthonormal
from impactlaw.stepping.compiled.left_out.tied_contacts import leave_out, parts_of_longest, write_lengths
from impactlaw.stepping.compiled.whitening import INERTIA, whitened
from impactlaw.stepping.time_stepping.compiled.state.kinds import ANSWER, NUMBERS, WORLD
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting
from impactlaw.stepping.time_stepping.problem.energy import find_islands
from impactlaw.stepping.time_stepping.problem.rows import ROWS
from impactlaw.stepping.time_stepping.problem.targets import reached_groups
from impactlaw.stepping.time_stepping.tolerances import DRIVEN

COUNT, ENERGY, SURFACE, INTENSITY, DISTANT, INADMISSIBLE = 0, 1, 2, 3, 4, 5
"""Indices of the sums: number of collisions, T+ - T-, work of drifted constraints in it, |v+ - v-|, and number of
collisions with a distant effect, and with restitution that creates energy in the step.
"""
_TOLERANCE, _ENOUGH, _ROUNDS = 1e-13, 1e-10, np.int64(24)
_DRIFT = 1e-10  # largest difference of a row's velocity from J v, relative to the row's part of |v-|
_ROUNDING = 5e-13  # energy that counts as rounding, relative to |v-|^2
_OUTSIDE = 1e-10  # part of |v-| by which an outcome may leave S(v-)


@kernel
def _constraints(w, rows, bound, basis):
    """Write an orthonormal basis of the constraints that keep their velocity, (m nv,), and return m."""
    nv, given, many, gaps = w.nv, 0.0, 0, row_floats(w, DATA.efc_pos)
    weight, part, dense = numbers(nv), numbers(number(w, DATA.ne)), zeros(len(basis))
    write_lengths(w, weight)
    kinds = flags(w.bilateral, size(w, MODEL.neq))
    parts_of_longest(row_ints(w, DATA.efc_id), kinds, jacobian_of(w, True), weight, part)
    for g in range(len(bound)):
        if bound[g]:
            given = max(given, abs(gaps[rows.sparse[2, rows.groups[0, g]]]))
    rank = least_length(w, given)
    for g in range(len(bound)):
        row = rows.groups[0, g]
        if bound[g] and part[rows.sparse[2, row]] > rank:
            for a in range(rows.sparse[1, row], rows.sparse[1, row] + rows.sparse[0, row]):
                dense[many * nv + rows.colind[a]] = rows.value[a]
            many += 1
    return orthonormal(dense, many, nv, rank, basis)


@plain
def _project(rows, members, basis, nv, nnz, adr, col, val):
    """Write dense rows without their part along constraints, 0 if only rounding is left, see `Bilateral.project`."""
    for r in range(len(nnz)):
        nnz[r], adr[r] = nv, r * nv
        for i in range(nv):
            col[r * nv + i], val[r * nv + i] = i, 0.0
    for g in members:
        for r in range(rows.groups[0, g], rows.groups[0, g] + rows.groups[1, g]):
            for a in range(rows.sparse[1, r], rows.sparse[1, r] + rows.sparse[0, r]):
                val[r * nv + rows.colind[a]] = rows.value[a]
            if leave_out(basis, len(basis) // nv, nv, val, r * nv) <= FIXED:
                clear(val[r * nv : r * nv + nv])


@once
def _beside(rows, members, basis, nv):
    """Return the rows beside constraints, valid until the calling function returns, as `_project` writes them."""
    n = rows.sparse.shape[1] if len(basis) > 0 else 0
    nnz, adr, col, val = integers(n), integers(n), integers(n * nv), numbers(n * nv)
    if n == 0:
        return rows.sparse[0], rows.sparse[1], rows.colind, rows.value
    _project(rows, members, basis, nv, nnz, adr, col, val)
    return nnz, adr, col, val


@plain
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
            b[r] = before - (target[g] if r == first else scale * sliding[r])
    return True


@plain
def _take(rows, members, impulse, first, sizes, kinds, x):
    """Write first rows, sizes and kinds of the groups that take part, and the impulses of the step as a guess."""
    for i in range(len(members)):
        g = members[i]
        first[i], sizes[i], kinds[i] = rows.groups[0, g], rows.groups[1, g], CONE
        for r in range(rows.groups[0, g], rows.groups[0, g] + rows.groups[1, g]):
            x[r] = impulse[r]  # of several solutions, the one that the step took


@plain
def _write_islands(rows, tree, label, island):
    """Write the island of each tree that contacts or constraints reach, (nv,)."""
    for g in range(len(label)):
        row = rows.groups[0, g]
        for a in range(rows.sparse[1, row], rows.sparse[1, row] + rows.sparse[0, row] if label[g] >= 0 else 0):
            island[tree[rows.colind[a]]] = label[g]


@kernel
def _add_work(rows, members, basis, x, v, tree, island, work, own):
    """Add the work of constraints, in their islands: they take the part of impulses along them, at the velocity v-."""
    nv, impulse = len(v), zeros(len(v))
    for g in members:
        for r in range(rows.groups[0, g], rows.groups[0, g] + rows.groups[1, g]):
            for a in range(rows.sparse[1, r], rows.sparse[1, r] + rows.sparse[0, r]):
                impulse[rows.colind[a]] += x[r] * rows.value[a]
    for at in range(0, len(basis), nv):
        done, i = -dot(basis, at, impulse, FIRST, nv) * dot(basis, at, v, FIRST, nv), island[tree[0]]
        for k in range(nv):
            i = island[tree[k]] if basis[at + k] != 0.0 else i
        work[i] += done
        own[i] += done


@kernel
def _book(rows, members, tree, basis, x, v, z, sums):
    """Add the properties of a collision to the sums; NaN if its outcome is not in S(v-), or constraints drive it."""
    label, distant, intensity, speed, count = counts(len(rows.key)), False, norm(z), norm(v), 0
    island = counts(len(v))
    if len(basis) > 0:
        count = find_islands(rows, tree, label)
    work, own, energy = zeros(count + 1), zeros(count + 1), numbers(count + 1)  # the last one of what cannot move
    energy[:] = _ROUNDING * speed * speed
    if len(basis) > 0:
        _write_islands(rows, tree, label, island)
        _add_work(rows, members, basis, x, v, tree, island, work, own)
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
            if r == first:
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


@linked(types.void(WORLD, ROWS, ANSWER, types.float64, types.float64, INERTIA, NUMBERS, NUMBERS))
def add_collision(w, rows, answer, share, created, metric, velocity, sums):
    """Add a collision of a phase to the sums, (`SUMS`,); NaN if its event is needed.

    Args:
        w: the world.
        rows: rows of the phase.
        answer: see `room.Answer`.
        share: share of the law's restitution that is kept.
        created: energy that the law would create in the step without scaling, J.
        metric: the mass matrix of the step.
        velocity: v-, (nv,).
        sums: see `COUNT`, written.
    """
    tree, n = model_ints(w, MODEL.dof_treeid, w.nv), len(answer.x)
    pushed, target, many = cleared(len(rows.key)), numbers(len(rows.key)), 0
    for g in range(len(pushed)):
        target[g] = answer.reached[g] if answer.collides[g] else 0.0
        pushed[g] = answer.x[rows.groups[0, g]] > 0.0
    reached = reached_groups(rows, tree, answer.collides, pushed)
    places = indices(len(reached))
    for g in range(len(reached)):
        if reached[g]:
            places[many], many = g, many + 1
    members = places[:many]
    root, v = numbers(w.nv), numbers(w.nv)
    for i in range(w.nv):
        root[i] = np.sqrt(metric.inverse[i])
    whitened(velocity, metric, root, v)
    room = numbers((number(w, DATA.ne) + 1) * w.nv if any_of(answer.bound) else 0)
    basis = room[: _constraints(w, rows, answer.bound, room) * w.nv if len(room) > 0 else 0]
    x, b = zeros(n), zeros(n)
    if not _aims(rows, members, v, norm(v), target, answer.sliding, b):
        sums[COUNT] = np.nan
        return
    nnz, adr, col, val = _beside(rows, members, basis, w.nv)
    first, sizes, kinds, z, left = integers(many), integers(many), integers(many), numbers(w.nv), zeros(1)
    _take(rows, members, answer.x, first, sizes, kinds, x)
    left[0] = 1.0
    residual, _ = linked_improve(
        nnz, adr, col, val, tree, first, sizes, kinds, zeros(many), zeros(n), b, setting(w, SETTING.exact) != 0.0,
        _TOLERANCE, _ROUNDS, left, x, z,
    )  # fmt: skip
    if not residual <= _ENOUGH:
        sums[COUNT] = np.nan
    _book(rows, members, tree, basis, x, v, z, sums)
    sums[INADMISSIBLE] += share < 1.0 or created > 0.0
