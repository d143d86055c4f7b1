"""The problem of one step: impulses of contacts, limits, equalities and dry friction all at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import (
    FLOATS,
    Array,
    clear,
    copied,
    integers,
    kernel,
    norm,
    numbers,
    plain,
    put,
    zeros,
)
from impactlaw.solvers.cones.solve import linked_improve
from impactlaw.stepping.time_stepping.problem.drifting_equalities import square_of
from impactlaw.stepping.time_stepping.problem.energy import is_met, row_velocities
from impactlaw.stepping.time_stepping.problem.rows import find_group
from impactlaw.stepping.time_stepping.problem.targets import write_offsets

_THROWN = 10.0  # velocity jump, relative to those of all contacts by themselves, that throws bodies
_GIVES = 1e-4  # compliance of contacts that give way, relative to their entries of the Delassus matrix
TOLERANCE = 1e-10
"""Residual of the natural map, relative to the largest velocity of the problem, that solvers aim at."""

UNSOLVED = 1e-8
"""Residual of the natural map above which normal velocities are corrected ..."""
_CORRECTED = 1e-9  # ... to this residual ...
_ONE = np.int64(1)  # ... in this number of rounds of slower methods
_CONVEX = np.bool_(False)


class Aims(NamedTuple):
    """What the step asks of its rows."""

    target: Array  # ``gamma^h`` with all restitution, (g,)
    sliding: Array  # target sliding velocities with all restitution, (n,)
    collides: Array  # which groups collide, bool (g,)


class Method(NamedTuple):
    """How problems are solved."""

    tree: Array  # tree of each degree of freedom, (nv,)
    exact: bool  # whether friction is exact Coulomb friction, or else its convex relaxation
    rounds: int  # rounds of the slower solvers
    left: Array  # remaining part of the work allowed in the step, (1,), see `solvers.cones.budget.spend`


class Solution(NamedTuple):
    """The impulses of a problem and the velocities that they lead to, with scratch space."""

    x: Array  # impulses, in units of the problem, (n,); a guess before the problem is solved
    z: Array  # whitened jump of velocities, (nv,)
    after: Array  # velocities of rows afterwards, (n,)
    reached: Array  # the targets that were aimed at, with restitution scaled, (g,)
    room: Array  # scratch space, (2 n,)


AIMS = types.NamedTuple([FLOATS, FLOATS, types.boolean[::1]], Aims)
METHOD = types.NamedTuple([types.int32[::1], types.boolean, types.int64, FLOATS], Method)
"""Types of these records in compiled code."""


@plain
def with_rounds(method, rounds):
    """Return the same method with another number of rounds."""
    return Method(method.tree, method.exact, rounds, method.left)


@plain
def improve(rows, method, b, tolerance, x, z):
    """Replace a guess x by the solution for the offsets b, (n,), and write its z; return the natural map."""
    residual, _ = linked_improve(
        rows.sparse[0], rows.sparse[1], rows.colind, rows.value, method.tree, rows.groups[0], rows.groups[1],
        rows.groups[2], rows.amounts[1], rows.rates[4], b, method.exact, tolerance, method.rounds, method.left, x, z,
    )  # fmt: skip
    return residual


@plain
def guess(rows, known, x):
    """Write the impulses of the last step for groups that are the same and have as many rows, else zeros, (n,).

    For these see `rows.Known`. Groups with equal keys are matched in order, see `rows.find_group`.
    """
    groups, scale, at = rows.groups, rows.rates[0], 0
    clear(x)
    for g in range(len(rows.key)):
        j = find_group(rows.key[g], known.key, at)
        if j >= 0 and known.groups[1, j] == groups[1, g]:
            for k in range(groups[1, g]):
                old = known.groups[0, j] + k
                x[groups[0, g] + k] = known.impulse[old] * known.scale[old] / scale[groups[0, g] + k]
        at = (j + 1) % len(known.key) if j >= 0 else at


@plain
def shortfall(rows, after, reached):
    """Return the largest amount by which a contact velocity misses its target, and the largest velocity of a row.

    Both are NaN if any velocity is.
    """
    groups, rates, missed, fastest, total = rows.groups, rows.rates, 0.0, 0.0, 0.0
    for g in range(len(reached)):
        if groups[2, g] == CONE:
            row = groups[0, g]
            missed = max(missed, reached[g] - after[row])
            for k in range(row, row + groups[1, g]):
                fastest = max(fastest, abs(rates[1, k]), abs(rates[2, k]))
                total += rates[1, k] + after[k]
    return (missed, fastest) if np.isfinite(total) else (np.nan, np.nan)


@kernel
def correct_normals(rows, method, b, solution, jump):
    """Make normal velocities of a solution and its z exact; return the residual of the natural map of that problem.

    If the residual is more than `UNSOLVED`, the solution is not changed.

    Friction impulses are fixed, after being cut to their cones, because friction is what makes problems hard: the rest,
    ``0 <= Lambda_n  ⊥  u_n >= 0``, is convex. Without friction this is the original problem, and it is solved again
    from zero impulses.
    """
    sparse, colind, value, groups = rows.sparse, rows.colind, rows.value, rows.groups
    x, offset, friction = copied(solution), copied(b), zeros(len(jump))
    for g in range(groups.shape[1]):
        if groups[2, g] != CONE:
            continue
        row, end = groups[0, g], groups[0, g] + groups[1, g]
        size = 0.0
        for k in range(row + 1, end):
            size += x[k] * x[k]
        share = min(1.0, x[row] / np.sqrt(size)) if size > 0.0 else 1.0
        for k in range(row + 1, end):
            for a in range(sparse[1, k], sparse[1, k] + sparse[0, k]):
                friction[colind[a]] += share * x[k] * value[a]
            x[k] *= share
    for r in range(len(b)):
        for a in range(sparse[1, r], sparse[1, r] + sparse[0, r]):
            offset[r] += value[a] * friction[colind[a]]
    start, one, tolerance = copied(x), integers(groups.shape[1]), _CORRECTED
    if len(x) == groups.shape[1]:
        clear(start)
        tolerance = TOLERANCE
    for g in range(groups.shape[1]):
        for k in range(groups[0, g] + 1, groups[0, g] + groups[1, g]):
            start[k] = 0.0
        one[g] = 1
    z = numbers(len(jump))
    reached, _ = linked_improve(
        sparse[0], sparse[1], colind, value, method.tree, groups[0], one, groups[2], rows.amounts[1], rows.rates[4],
        offset, _CONVEX, tolerance, min(method.rounds, _ONE), method.left, start, z,
    )  # fmt: skip
    if not reached > UNSOLVED:
        for g in range(groups.shape[1]):
            x[groups[0, g]] = start[groups[0, g]]
        put(solution, x)
        for i in range(len(z)):
            jump[i] = z[i] + friction[i]
    return reached


@kernel
def without_friction(rows, method, b, solution, jump):
    """Replace a solution and its z by those without friction, if these satisfy normal velocities; return whether."""
    x, z = zeros(len(b)), zeros(len(jump))
    if correct_normals(rows, method, b, x, z) > UNSOLVED:
        return False
    put(solution, x)
    put(jump, z)
    return True


@plain
def throws(rows, z):
    """Return whether a velocity jump is out of all proportion to the velocities of contacts, each by itself.

    Normals of surfaces that squeeze a body, but for the last digits, are opposite to each other. Then there is a
    solution without friction: the body is thrown out between them.
    """
    total = 0.0
    for g in range(rows.groups.shape[1]):
        row = rows.groups[0, g]
        speed, square = max(abs(rows.rates[1, row]), abs(rows.rates[2, row])), square_of(rows, row)
        total += speed * speed / square if square > 0.0 else 0.0
    return norm(z) > _THROWN * np.sqrt(total)


@kernel
def give_way(rows, aims, method, found):
    """Write the solution of the problem without friction whose contacts give way: those that oppose each other share.

    They have a compliance of a part `_GIVES` of their entries of the Delassus matrix.
    """
    n, groups, one = len(found.x), rows.groups, integers(rows.groups.shape[1])
    b, soft = found.room[:n], found.room[n : 2 * n]
    write_offsets(groups, rows.rates, found.reached, aims.sliding, b)
    put(soft, rows.rates[4])
    for g in range(groups.shape[1]):
        one[g] = 1
        if groups[2, g] == CONE:
            soft[groups[0, g]] = _GIVES * square_of(rows, groups[0, g])
    clear(found.x)
    linked_improve(
        rows.sparse[0], rows.sparse[1], rows.colind, rows.value, method.tree, groups[0], one, groups[2],
        rows.amounts[1], soft, b, _CONVEX, TOLERANCE, min(method.rounds, _ONE), method.left, found.x, found.z,
    )  # fmt: skip
    row_velocities(rows, found.z, found.after)


@plain
def solve_scaled(rows, aims, s, method, found):
    """Solve the problem of a step with all restitution of colliding contacts scaled by s; write the solution found.

    Return the residual of the natural map, relative to the largest velocity.
    """
    n, groups = len(found.x), rows.groups
    aimed, b = found.room[:n], found.room[n : 2 * n]
    put(found.reached, aims.target)
    put(aimed, aims.sliding)
    for g in range(len(aims.target)):
        if aims.collides[g] and s < 1.0:
            found.reached[g] = s * aims.target[g] if aims.target[g] > 0.0 else aims.target[g]
            for k in range(groups[0, g] + 1, groups[0, g] + groups[1, g]):
                aimed[k] = s * aims.sliding[k]
    write_offsets(groups, rows.rates, found.reached, aimed, b)
    residual = improve(rows, method, b, TOLERANCE, found.x, found.z)
    row_velocities(rows, found.z, found.after)
    if residual > UNSOLVED or not is_met(*shortfall(rows, found.after, found.reached)):
        reached = correct_normals(rows, method, b, found.x, found.z)
        row_velocities(rows, found.z, found.after)
        if reached <= UNSOLVED and n == groups.shape[1]:  # without friction, that was the whole problem
            residual = reached
    return residual
