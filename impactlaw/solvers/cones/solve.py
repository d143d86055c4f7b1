"""Solve a contact problem with friction, of any number of rows, in one call.

Islands, which share no degree of freedom, are solved one by one. See `structure` for the problem, and `hybrid` for the
order of attempts.
"""

import numpy as np
from numba import types

from impactlaw.compiled import compiled
from impactlaw.linked import by_address, linked
from impactlaw.solvers.cones.algebra.loops import (
    FLOATS,
    INTEGERS,
    Array,
    any_of,
    clear,
    counts,
    indices,
    numbers,
    plain,
    unset,
)
from impactlaw.solvers.cones.convex import out_of_reach
from impactlaw.solvers.cones.hybrid import solve_island
from impactlaw.solvers.cones.islands import build
from impactlaw.solvers.cones.rows import PROBLEM, Problem, certificate, impulse_jump, islands, longest_group


@linked(
    types.int64(
        INTEGERS, PROBLEM, FLOATS, INTEGERS, INTEGERS, FLOATS, types.float64, types.float64, types.int64, FLOATS
    )
)
def solve_one(members, problem, length, number, seen, x, scale, tolerance, rounds, left):
    """Overwrite the impulses of the groups of one island by its solution; return the steps taken.

    Without impulses, that is if x is empty, return whether bodies jam, see `convex.out_of_reach`.
    """
    first, size = problem.first, problem.size
    P, K = build(members, problem, length, number, seen)
    if len(x) == 0:
        return np.int64(out_of_reach(P, K, scale)[1])
    point = numbers(len(P.b))
    for j in range(len(members)):
        g = members[j]
        for k in range(size[g]):
            point[P.start[j] + k] = x[first[g] + k] * length[g]
    taken, _ = solve_island(P, K, point, scale, tolerance * scale, rounds, left)
    for j in range(len(members)):
        g = members[j]
        for k in range(size[g]):
            x[first[g] + k] = point[P.start[j] + k] / length[g]
    return taken


@plain
def _clean(first: Array, size: Array, label: Array, x: Array) -> None:
    """Set impulses of groups that cannot move, and impulses that are not finite or huge, to 0."""
    for g in range(len(first)):
        if label[g] < 0:
            for i in range(first[g], first[g] + size[g]):
                x[i] = 0.0
    for i in range(len(x)):
        if not abs(x[i]) < 1e100:
            x[i] = 0.0


@plain
def in_islands(label: Array, begin: Array, at: Array, order: Array) -> None:
    """Sort the groups by island.

    Args:
        label: island of each group, -1 for none.
        begin: zeros; overwritten by the place in `order` at which each island begins, (islands + 1,).
        at: room for one number per island.
        order: overwritten by the groups, one island after another.
    """
    for g in range(len(label)):
        if label[g] >= 0:
            begin[label[g] + 1] += 1
    for i in range(len(at)):
        begin[i + 1] += begin[i]
        at[i] = begin[i]
    for g in range(len(label)):
        if label[g] >= 0:
            order[at[label[g]]] = g
            at[label[g]] += 1


@compiled(
    "Tuple((float64,int64))(int32[::1],int32[::1],int32[::1],float64[::1],int32[::1],int32[::1],int32[::1],int32[::1],"
    "float64[::1],float64[::1],float64[::1],boolean,float64,int64,float64[::1],float64[::1],float64[::1])"
)
def improve(
    rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, exact, tolerance, rounds, left, x, z
):  # fmt: skip
    """Overwrite a guess x by the solution, write z, and return the other results of `solve`; see there.

    `left` (1,) is the remaining part of the allowed work, see `budget.spend`; the work done is subtracted from it. If
    no work is left, only Newton's first attempt is made; in a convex problem, all its first attempts are.
    """
    problem = Problem(rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, exact)
    length, label = numbers(len(first)), indices(len(first))
    count = islands(rownnz, rowadr, colind, value, tree, first, size, compliance, length, label)
    scale, squares, room = numbers(count), numbers(count), numbers(2 * longest_group(size))
    _clean(first, size, label, x)
    if not any_of(b):  # nothing to change, and no scale for the natural map
        clear(x)
    impulse_jump(rownnz, rowadr, colind, value, x, z)
    worst = certificate(problem, x, z, length, label, scale, squares, room)
    total = 0
    if worst <= tolerance:
        return worst, total
    begin, at, order = counts(count + 1), indices(count), indices(len(first))
    in_islands(label, begin, at, order)
    number, seen = unset(len(tree)), unset(len(tree))
    for i in range(count):
        if np.sqrt(squares[i]) <= tolerance * scale[i]:
            continue
        members = order[begin[i] : begin[i + 1]]
        total += solve_one(members, problem, length, number, seen, x, scale[i], tolerance, rounds, left)
    impulse_jump(rownnz, rowadr, colind, value, x, z)
    return certificate(problem, x, z, length, label, scale, squares, room), total


linked_improve = by_address(improve)
"""The form of `improve` that compiled functions call."""


@compiled(
    "Tuple((float64[::1],float64[::1],float64,int64))(int32[::1],int32[::1],int32[::1],float64[::1],int64,int32[::1],"
    "int32[::1],int32[::1],int32[::1],float64[::1],float64[::1],float64[::1],float64[::1],boolean,float64,int64,float64)"
)
def solve(
    rownnz, rowadr, colind, value, nv, tree, first, size, kind, bound, compliance, b, x0, exact, tolerance, rounds, work
):  # fmt: skip
    """Return x, ``z = Y^T x``, the relative natural map at x, and the total number of steps.

    The arguments are the fields of `rows.Problem`, the number of degrees of freedom, and a guess `x0`, (n,). The
    natural map may be as large as the tolerance, relative to the scale of each island. If Newton's method fails, there
    are at most `rounds` rounds of slower methods. The allowed `work` is a part of that of a time step; infinite for no
    limit.
    """
    x, z, left = x0.copy(), np.zeros(nv), np.full(1, work)
    worst, total = linked_improve(
        rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, exact, tolerance, rounds, left,
        x, z,
    )  # fmt: skip
    return x, z, worst, total
