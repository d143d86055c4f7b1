"""The problem of one step: impulses of contacts, limits, equalities and dry friction all at once."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import clear, copied, integers, kernel, numbers, plain, put, zeros
from impactlaw.solvers.cones.solve import linked_improve
from impactlaw.stepping.time_stepping.problem.energy import is_met, row_velocities
from impactlaw.stepping.time_stepping.problem.rows import find_group
from impactlaw.stepping.time_stepping.problem.targets import write_offsets

TOLERANCE = 1e-10
"""Residual of the natural map, relative to the largest velocity of the problem, that solvers aim at."""

UNSOLVED = 1e-8
"""Residual of the natural map above which normal velocities are corrected ..."""
_CORRECTED = 1e-9  # ... to this residual ...
_ONE = np.int64(1)  # ... in this number of rounds of slower methods
_CONVEX = np.bool_(False)


@plain
def guess(groups, key, scale, known_groups, known_key, known_scale, known, x):
    """Write the impulses of the last step for groups that are the same and have as many rows, else zeros, (n,).

    Groups with equal keys are matched in order, see `rows.find_group`.
    """
    clear(x)
    at = 0
    for g in range(len(key)):
        j = find_group(key[g], known_key, at)
        if j >= 0 and known_groups[1, j] == groups[1, g]:
            for k in range(groups[1, g]):
                old = known_groups[0, j] + k
                x[groups[0, g] + k] = known[old] * known_scale[old] / scale[groups[0, g] + k]
        at = (j + 1) % len(known_key) if j >= 0 else at


@plain
def shortfall(groups, rates, after, reached):
    """Return the largest amount by which a contact velocity misses its target, and the largest velocity of a row.

    Both are NaN if any velocity is.
    """
    missed, fastest, total = 0.0, 0.0, 0.0
    for g in range(len(reached)):
        if groups[2, g] == CONE:
            row = groups[0, g]
            missed = max(missed, reached[g] - after[row])
            for k in range(row, row + groups[1, g]):
                fastest = max(fastest, abs(rates[1, k]), abs(rates[2, k]))
                total += rates[1, k] + after[k]
    return (missed, fastest) if np.isfinite(total) else (np.nan, np.nan)


@kernel
def correct_normals(sparse, colind, value, groups, amounts, rates, b, tree, rounds, left, solution, jump):
    """Make normal velocities of a solution and its z exact; return the residual of the natural map of that problem.

    If the residual is more than `UNSOLVED`, the solution is not changed.

    Friction impulses are fixed, after being cut to their cones, because friction is what makes problems hard: the rest,
    ``0 <= Lambda_n  ⊥  u_n >= 0``, is convex. Without friction this is the original problem, and it is solved again
    from zero impulses.
    """
    x, offset, friction = copied(solution), copied(b), zeros(len(tree))
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
    z = numbers(len(tree))
    reached, _ = linked_improve(
        sparse[0], sparse[1], colind, value, tree, groups[0], one, groups[2], amounts[1], rates[4], offset, _CONVEX,
        tolerance, min(rounds, _ONE), left, start, z,
    )  # fmt: skip
    if not reached > UNSOLVED:
        for g in range(groups.shape[1]):
            x[groups[0, g]] = start[groups[0, g]]
        put(solution, x)
        for i in range(len(z)):
            jump[i] = z[i] + friction[i]
    return reached


@kernel
def without_friction(sparse, colind, value, groups, amounts, rates, b, tree, rounds, left, solution, jump):
    """Replace a solution and its z by those without friction, if these satisfy normal velocities; return whether."""
    x, z = zeros(len(b)), zeros(len(tree))
    reached = correct_normals(sparse, colind, value, groups, amounts, rates, b, tree, rounds, left, x, z)
    if reached > UNSOLVED:
        return False
    put(solution, x)
    put(jump, z)
    return True


@plain
def solve_scaled(
    sparse, colind, value, groups, amounts, rates, target, sliding, collides, s, tree, exact, rounds, left,
    x, z, after, scaled, room,
):  # fmt: skip
    """Solve the problem of a step with all restitution of colliding contacts scaled by s.

    Written are impulses (n,), in units of the problem, which are a guess on entry; the whitened jump of velocities
    (nv,); the velocities of rows afterwards (n,); and the targets with s, (g,). ``room``, (2 n,), is scratch space.
    Return the residual of the natural map, relative to the largest velocity.
    """
    aimed, b = room[: len(x)], room[len(x) : 2 * len(x)]
    put(scaled, target)
    put(aimed, sliding)
    for g in range(len(target)):
        if collides[g] and s < 1.0:
            scaled[g] = s * target[g] if target[g] > 0.0 else target[g]
            for k in range(groups[0, g] + 1, groups[0, g] + groups[1, g]):
                aimed[k] = s * sliding[k]
    write_offsets(groups, rates, scaled, aimed, b)
    residual, _ = linked_improve(
        sparse[0], sparse[1], colind, value, tree, groups[0], groups[1], groups[2], amounts[1], rates[4], b, exact,
        TOLERANCE, rounds, left, x, z,
    )  # fmt: skip
    row_velocities(sparse, colind, value, rates, z, after)
    if residual > UNSOLVED or not is_met(*shortfall(groups, rates, after, scaled)):
        reached = correct_normals(sparse, colind, value, groups, amounts, rates, b, tree, rounds, left, x, z)
        row_velocities(sparse, colind, value, rates, z, after)
        if reached <= UNSOLVED and len(x) == groups.shape[1]:  # without friction, that was the whole problem
            residual = reached
    return residual
