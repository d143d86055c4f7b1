"""Impulses of a collision with all restitution, or with the largest share of it that creates no energy.

See `laws.friction.scaled`. Bodies that jam, so that friction leaves no solution with restitution, lose all of it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types

from impactlaw.laws.friction import share
from impactlaw.laws.friction.share import AIM, CREATED, FOUND, SEARCHES, SOLVABLE
from impactlaw.linked import linked
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import (
    FLOATS,
    INTEGERS,
    clear,
    cleared,
    copied,
    indices,
    kernel,
    norm,
    numbers,
    plain,
    put,
    zeros,
)
from impactlaw.solvers.cones.jams import linked_jams
from impactlaw.solvers.cones.rows import impulse_jump, lengths
from impactlaw.solvers.cones.solve import linked_improve
from impactlaw.solvers.friction import problem
from impactlaw.stepping.compiled.access import model_ints
from impactlaw.stepping.compiled.fields import MODEL
from impactlaw.stepping.soft.compiled.contacts.kinds import ROWS, WORLD, typeof
from impactlaw.stepping.soft.compiled.contacts.rows import influenced
from impactlaw.stepping.soft.compiled.contacts.work import most_gained, work_of_each
from impactlaw.stepping.soft.compiled.single_contact import solve_alone

Array = np.ndarray[Any, Any]

ENOUGH = problem.ENOUGH
"""Natural map that the solver must reach, relative to velocities."""
_CLEAR = 1e-12  # natural map from which no further attempt is made to improve it
_TOLERANCE = 1e-13  # natural map that the solver aims at
_ROUNDS = 24  # rounds of its slower methods
_AGAIN = 4  # largest number of attempts; the first one is without the slower methods
_RESERVE = 0.1  # part of the work allowed to an instant that is left for impulses without restitution
_WORTH_IT = 0.5  # remaining part of the natural map up to which another attempt is worth it
_NONE = np.inf  # created energy if no impulses were found
_next_share = plain(share.next_share)


class CollisionProblem(NamedTuple):
    """The data of a collision problem."""

    exact: bool  # whether friction is exact Coulomb friction, or else its convex relaxation
    before: Array  # velocities of all rows before the collision, (n,)
    # e times these velocities where restitution acts, else 0, (n,); a share s of restitution asks for the jump
    # ``-(before + s restored)``. `find_impulses` multiplies it by the share that it has found
    restored: Array
    velocity: Array  # whitened velocity before the collision, (nv,)
    speed: float  # its length
    left: Array  # see `world.Law`


_PROBLEM = typeof(CollisionProblem(True, np.zeros(0), np.zeros(0), np.zeros(0), 0.0, np.zeros(0)))


@kernel
def _sharpness(rows, members, firsts, sizes, compliance, b, velocity):
    """Return the ratio of the speed of the bodies that take part to the velocity jump asked of them, at least 1.

    Rounding is relative to the speed of bodies. Contacts that rest on fast bodies therefore cannot be solved to the
    same accuracy relative to their own, smaller velocities.
    """
    length, touched, asked, square = numbers(len(members)), cleared(len(velocity)), 0.0, 0.0
    lengths(rows.nnz, rows.adr, rows.val, firsts, sizes, compliance, length)
    for j in range(len(members)):
        own = 0.0
        for i in range(firsts[j], firsts[j] + sizes[j]):
            own += b[i] * b[i]
            for a in range(rows.adr[i], rows.adr[i] + rows.nnz[i]):
                d = rows.col[a]
                square += 0.0 if touched[d] else velocity[d] ** 2
                touched[d] = True
        if length[j] > 0.0:
            asked = max(asked, np.sqrt(own) / length[j])
    return max(1.0, np.sqrt(square) / asked) if asked > 0.0 else 1.0


@kernel
def _solve(w, rows, members, problem, s, x, z):
    """Improve a guess x of impulses, (n,), for a share s of restitution, write their jump z; return the natural map."""
    n, k, b, residual, left = len(x), len(members), numbers(len(x)), np.inf, problem.left
    for i in range(n):
        b[i] = problem.before[i] + s * problem.restored[i]
    first, count = rows.first[members[0]], rows.sizes[members[0]]
    if k == 1 and count <= 3 and (problem.exact or count == 1):
        if solve_alone(rows, first, count, b, indices(3), numbers(24), x, z):
            return 0.0
    tree, firsts, sizes = model_ints(w, MODEL.dof_treeid, w.nv), rows.first[members], rows.sizes[members]
    kinds, bounds, compliance = np.full(k, CONE, np.int32), zeros(k), zeros(n)
    sharp = _sharpness(rows, members, firsts, sizes, compliance, b, problem.velocity)
    for attempt in range(_AGAIN):
        before = residual
        residual, _ = linked_improve(
            rows.nnz, rows.adr, rows.col, rows.val, tree, firsts, sizes, kinds, bounds, compliance, b, problem.exact,
            sharp * _TOLERANCE, 0 if attempt == 0 else _ROUNDS, left, x, z,
        )  # fmt: skip
        residual /= sharp
        if residual <= _CLEAR or not residual < _WORTH_IT * before or left[0] <= 0.0:
            break
        if attempt == 0 and linked_jams(
            rows.nnz, rows.adr, rows.col, rows.val, tree, firsts, sizes, kinds, bounds, compliance, b, problem.exact
        ):
            break
    return residual


@plain
def _created(problem, done, z, residual):
    """Return the energy that contacts create, relative to the kinetic energy, less what may be rounding."""
    total, speed = 0.0, max(problem.speed, norm(z))
    for work in done:
        total += work
    if not residual <= ENOUGH:
        return _NONE
    return 2.0 * total / speed**2 - CREATED - 4.0 * residual if speed > 0.0 else 0.0


@kernel
def _attempt(w, rows, members, problem, s, x, z):
    """Do what `_solve` does, and also return the created energy."""
    residual, done = _solve(w, rows, members, problem, s, x, z), numbers(len(members))
    work_of_each(rows, members, x, z, problem.before, 0.0, done)
    return residual, _created(problem, done, z, residual)


@kernel
def _largest(w, rows, group, problem, created, x):
    """Write impulses, (n,), with the largest share of restitution that creates no energy; return natural map and share.

    All restitution would create the energy `created`.
    """
    clear(x)
    z, low, high, third, above = zeros(w.nv), 0.0, 1.0, np.nan, created + AIM
    problem.left[0] = max(problem.left[0], _RESERVE)
    best, below = _attempt(w, rows, group, problem, 0.0, x, z)
    below, beyond, stalled = below + AIM, np.nan, False
    if not best <= ENOUGH or created == _NONE:
        return best, 0.0
    trial = numbers(len(x))
    for _ in range(SEARCHES):
        if high - low <= (FOUND if above < _NONE else SOLVABLE) or problem.left[0] <= 0.0:
            break
        s = _next_share(low, high, third, below, above, beyond, stalled)
        put(trial, x)
        residual, missed = _attempt(w, rows, group, problem, s, trial, z)
        missed += AIM
        stalled = abs(missed) > 0.5 * min(abs(below), above)
        if missed > AIM:
            third, high, beyond, above = high, s, above, missed
            continue
        third, low, beyond, below, best = low, s, below, missed, residual
        put(x, trial)
        if missed > -AIM:
            break
    return best, low


@kernel
def _of_group(w, rows, group, problem, is_whole, solved, done, z, x):
    """Write impulses, (n,), of a group of contacts that influence no others, with all restitution or a share of it.

    Args:
        w: the world.
        rows: the whitened rows.
        group: the contacts, int64.
        problem: see `CollisionProblem`.
        is_whole: whether the group contains all contacts.
        solved: natural map of the solution for all contacts with all restitution.
        done: work of each contact of the group in that solution.
        z: velocity jump of that solution.
        x: impulses of that solution, 0 for other contacts; overwritten.

    Returns:
        The natural map, and the share of restitution.
    """
    created = _created(problem, done, z, solved)
    if created == _NONE and not is_whole:
        own = zeros(w.nv)
        clear(x)
        solved, created = _attempt(w, rows, group, problem, 1.0, x, own)
    restored = False
    for g in group:
        for i in range(rows.first[g], rows.first[g] + rows.sizes[g]):
            restored = restored or problem.restored[i] != 0.0
    if created <= 0.0 or not restored:
        return solved, 1.0
    return _largest(w, rows, group, problem, created, x)


@kernel
def _in_groups(w, rows, members, problem, solved, done, z, x):
    """Do what `_of_group` does for each group of contacts; return the largest natural map and the least share."""
    n, k, share, worst = len(x), len(rows.of), 1.0, 0.0
    whole, own, work, seen, queue = copied(x), numbers(n), zeros(k), cleared(k), indices(k)
    for j in range(len(members)):
        work[members[j]] = done[j]
    clear(x)
    for g in members:
        if seen[g]:
            continue
        group = queue[: influenced(rows, g, w.nv, queue)]
        clear(own)
        for other in group:
            seen[other] = True
            for i in range(rows.first[other], rows.first[other] + rows.sizes[other]):
                own[i] = whole[i]
        is_whole = len(group) == len(members)
        residual, s = _of_group(w, rows, group, problem, is_whole, solved, work[group], z, own)
        worst, share = max(worst, residual), min(share, s)
        for i in range(n):
            x[i] += own[i]
        for other in group:
            for i in range(rows.first[other], rows.first[other] + rows.sizes[other]):
                problem.restored[i] *= s
    return worst, share


@linked(types.UniTuple(types.float64, 2)(WORLD, ROWS, INTEGERS, _PROBLEM, FLOATS, FLOATS))
def find_impulses(w, rows, members, problem, x, z):
    """Write impulses and their velocity jump; return the natural map and the least share of restitution of a group.

    Args:
        w: the world.
        rows: the whitened rows.
        members: contacts that take part, int64 (k,).
        problem: see `CollisionProblem`.
        x: impulses, zeros before, (n,), written.
        z: velocity jump, zeros before, (nv,), written.
    """
    residual, done = _solve(w, rows, members, problem, 1.0, x, z), numbers(len(members))
    work_of_each(rows, members, x, z, problem.before, 0.0, done)
    if residual <= ENOUGH:
        larger = max(problem.speed, norm(z))
        allowed = 0.5 * (CREATED + 4.0 * residual) * larger * larger
        if most_gained(rows, members, done, allowed, w.nv) <= allowed:
            return residual, 1.0
    residual, share = _in_groups(w, rows, members, problem, residual, done, z, x)
    impulse_jump(rows.nnz, rows.adr, rows.col, rows.val, x, z)
    return residual, share
