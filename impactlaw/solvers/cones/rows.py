"""A problem by its rows in their original form: lengths of groups, islands, jump and natural map."""

from typing import Any, NamedTuple

import numpy as np
from numba import types

from impactlaw.solvers.cones.algebra.loops import FIRST, FLOATS, Array, clear, indices, kernel, plain
from impactlaw.solvers.cones.algebra.projection import group_residual

_NOTHING = 1e-10  # length of a row, relative to the longest, up to which it counts as zero
_SHARE = 1e-3  # least scale of an island, relative to the largest


class Problem(NamedTuple):
    """A problem by its rows; see `structure`."""

    rownnz: Array  # number of entries of each row of Y, (n,)
    rowadr: Array  # first entry of each row, (n,)
    colind: Array  # columns of the entries
    value: Array  # the entries; Y is whitened, so that the kinetic metric is Euclidean
    tree: Array  # kinematic tree of each degree of freedom, (nv,)
    first: Array  # first row of each group, (g,)
    size: Array  # number of rows of each group, (g,)
    kind: Array  # `BILATERAL`, `BOX` or `CONE`, (g,)
    bound: Array  # bound of box rows, (g,)
    compliance: Array  # added to the diagonal of ``Y Y^T``, (n,)
    b: Array  # offset of the velocity, (n,)
    exact: bool  # whether friction is exact Coulomb friction or its convex relaxation


_INTS: Any = types.int32[::1]
PROBLEM: Any = types.NamedTuple(
    [_INTS, _INTS, _INTS, FLOATS, *[_INTS] * 4, FLOATS, FLOATS, FLOATS, types.boolean], Problem
)
"""The type of a `Problem` in compiled code."""


@plain
def lengths(rownnz: Array, rowadr: Array, value: Array, first: Array, size: Array, c: Array, length: Array) -> None:
    """Write the length of each group: of its longest row, else the root of its compliance, else 0 (it cannot move).

    A contact whose normal gradient counts as zero cannot move either: any normal force would be a solution, and with it
    any friction.
    """
    longest = 0.0
    for g in range(len(first)):
        normal, most = 0.0, 0.0
        for i in range(first[g], first[g] + size[g]):
            s = 0.0
            for k in range(rowadr[i], rowadr[i] + rownnz[i]):
                s += value[k] * value[k]
            if i == first[g]:
                normal = s
            most = max(most, s)
        length[g] = np.sqrt(most) if normal > _NOTHING**2 * most else 0.0
        longest = max(longest, length[g])
    for g in range(len(first)):
        if length[g] <= _NOTHING * longest:
            most = 0.0
            for i in range(first[g], first[g] + size[g]):
                most = max(most, c[i])
            length[g] = np.sqrt(most)


@plain
def root_of(parent: Array, i: int) -> int:
    """Return the representative of the set that contains i (union-find); the path in ``parent`` is shortened."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@plain
def trees_of(tree: Array) -> int:
    """Return the number of kinematic trees, up to the last one with degrees of freedom."""
    trees = 0
    for t in tree:
        trees = max(trees, t + 1)
    return trees


@plain
def longest_group(size: Array) -> int:
    """Return the largest number of rows of a group."""
    most = 0
    for g in range(len(size)):
        most = max(most, size[g])
    return most


@kernel
def islands(
    rownnz: Array, rowadr: Array, colind: Array, value: Array, tree: Array, first: Array, size: Array, c: Array,
    length: Array, label: Array,
) -> int:  # fmt: skip
    """Write `lengths`, and the island of each group, -1 for a group that cannot move; return the number of islands."""
    lengths(rownnz, rowadr, value, first, size, c, length)
    trees = trees_of(tree)
    parent, number = indices(trees), indices(trees)
    for t in range(trees):
        parent[t], number[t] = t, -1
    for g in range(len(first)):
        label[g] = -1
        if length[g] > 0.0:
            for i in range(first[g], first[g] + size[g]):
                for k in range(rowadr[i], rowadr[i] + rownnz[i]):
                    t = np.int64(tree[colind[k]])
                    if value[k] != 0.0 and t != label[g]:
                        t = root_of(parent, t)
                        if label[g] < 0:
                            label[g] = t
                        elif t != label[g]:
                            root = root_of(parent, label[g])
                            parent[t] = root
                            label[g] = root
    count = 0
    for g in range(len(first)):
        if length[g] > 0.0:
            if label[g] < 0:  # the group has compliance, but no gradient
                label[g] = count
                count += 1
                continue
            t = root_of(parent, label[g])
            if number[t] < 0:
                number[t] = count
                count += 1
            label[g] = number[t]
    return count


@plain
def impulse_jump(rownnz: Array, rowadr: Array, colind: Array, value: Array, x: Array, z: Array) -> None:
    """Write ``z = Y^T x``."""
    clear(z)
    for i in range(len(x)):
        if x[i] != 0.0:
            for k in range(rowadr[i], rowadr[i] + rownnz[i]):
                z[colind[k]] += value[k] * x[i]


@plain
def group_error(problem: Problem, x: Array, z: Array, length: Array, g: int, room: Array) -> tuple[float, float]:
    """Return the squared natural map of a group, and its ``|b| / length``; for room see `certificate`."""
    xs, us, size = room[: len(room) // 2], room[len(room) // 2 :], problem.size[g]
    s, inverse, b = 0.0, 1.0 / length[g], problem.b
    for m in range(size):
        i = problem.first[g] + m
        u = b[i] + problem.compliance[i] * x[i]
        for k in range(problem.rowadr[i], problem.rowadr[i] + problem.rownnz[i]):
            u += problem.value[k] * z[problem.colind[k]]
        us[m], xs[m] = u * inverse, x[i] * length[g]
        s += b[i] * b[i]
    half = problem.bound[g] * length[g]
    square = group_residual(np.int64(problem.kind[g]), half, xs, us, FIRST, np.int64(size), problem.exact)
    return square, np.sqrt(s) * inverse


@plain
def certificate(
    problem: Problem, x: Array, z: Array, length: Array, label: Array, scale: Array, squares: Array, room: Array
) -> float:
    """Write scale and squared natural map of each island; return the largest natural map relative to its scale.

    The scale is the largest ``|b| / length`` of the groups of the island, but at least 1e-3 of the largest one overall.
    `room` has space for twice the rows of the longest group.
    """
    clear(scale)
    clear(squares)
    largest = 0.0
    for g in range(len(label)):
        if label[g] < 0:
            continue
        square, s = group_error(problem, x, z, length, g, room)
        largest = max(largest, s)
        scale[label[g]] = max(scale[label[g]], s)
        squares[label[g]] += square
    worst = 0.0
    for i in range(len(scale)):
        scale[i] = max(scale[i], _SHARE * largest, 1e-300)
        ratio = np.sqrt(squares[i]) / scale[i]
        worst = max(worst, ratio if ratio >= 0.0 else np.inf)
    return worst
