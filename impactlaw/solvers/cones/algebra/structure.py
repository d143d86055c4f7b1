"""The scaled problem of one island, and products with its rows.

With ``z = A^T x`` and the compliance ``c >= 0`` of each row, the contact velocity is ``u = A z + c x + b``. Groups of
rows (contacts, or single bilateral and box rows) are divided by their length, so that x and u are in sqrt(J). The
columns of a group are stored once for all its rows.
"""

from typing import Any, NamedTuple

from numba import types

from impactlaw.solvers.cones.algebra.loops import (
    FLOATS,
    INTEGERS,
    UNSIGNED,
    Array,
    clear,
    gather_dot,
    gather_three,
    kernel,
    plain,
    scatter_add,
    scatter_three,
    zeros,
)

BILATERAL, BOX, CONE = 0, 1, 2
"""Kinds of groups: ``u = 0``; ``x`` in an interval; ``x`` in the cone ``K = {(a, y) : |y| <= a}``."""


class Island(NamedTuple):
    """The problem of one island."""

    start: Array  # first row of each group, and the number of rows n, (g + 1,)
    kind: Array  # kind of each group, (g,)
    bound: Array  # half width of the interval of a box row, (g,)
    c: Array  # compliance, (n,)
    b: Array  # offset of the velocity, (n,)
    begin: Array  # first column of each group in `cols`, (g + 1,)
    cols: Array  # degrees of freedom of the columns of each group, in the order of elimination; unsigned
    entry: Array  # start of the block of each group in `A`, (g + 1,)
    A: Array  # blocks of the groups, row by row
    square: Array  # start of the m x m matrix of each group in an array that holds these one after another, (g + 1,)
    nv: int  # number of degrees of freedom
    exact: bool  # whether friction is exact Coulomb friction after de Saxcé, or its convex relaxation


ISLAND: Any = types.NamedTuple(
    [
        INTEGERS, INTEGERS, FLOATS, FLOATS, FLOATS, INTEGERS, UNSIGNED, INTEGERS, FLOATS, INTEGERS, types.int64,
        types.boolean,
    ],
    Island,
)  # fmt: skip
"""The type of an `Island` in compiled code."""


@plain
def jump(P: Island, x: Array, z: Array) -> None:
    """Write ``z = A^T x``."""
    clear(z)
    for g in range(len(P.kind)):
        begin, a = P.begin[g], P.entry[g]
        width, i, end = P.begin[g + 1] - begin, P.start[g], P.start[g + 1]
        while i < end:
            if i + 3 <= end:
                if x[i] != 0.0 or x[i + 1] != 0.0 or x[i + 2] != 0.0:
                    scatter_three(P.A, a, x, i, z, P.cols, begin, width)
                i, a = i + 3, a + 3 * width
            else:
                if x[i] != 0.0:
                    scatter_add(P.A, a, x[i], z, P.cols, begin, width)
                i, a = i + 1, a + width


@plain
def rows_times(P: Island, z: Array, w: Array) -> None:
    """Write ``w = A z``."""
    for g in range(len(P.kind)):
        begin, a = P.begin[g], P.entry[g]
        width, i, end = P.begin[g + 1] - begin, P.start[g], P.start[g + 1]
        while i < end:
            if i + 3 <= end:
                gather_three(P.A, a, z, P.cols, begin, width, w, i)
                i, a = i + 3, a + 3 * width
            else:
                w[i] = gather_dot(P.A, a, z, P.cols, begin, width)
                i, a = i + 1, a + width


@plain
def velocity(P: Island, b: Array, x: Array, z: Array, u: Array) -> None:
    """Write ``z = A^T x`` and ``u = A z + c x + b``."""
    jump(P, x, z)
    rows_times(P, z, u)
    for i in range(len(u)):
        u[i] += P.c[i] * x[i] + b[i]


@kernel
def delassus(P: Island, G: Array) -> None:
    """Write the dense matrix ``G = A A^T`` with the compliance on its diagonal, row by row."""
    row, n, groups = zeros(P.nv), len(P.b), len(P.kind)
    for g in range(groups):
        begin, width = P.begin[g], P.begin[g + 1] - P.begin[g]
        for i in range(P.start[g], P.start[g + 1]):
            a = P.entry[g] + (i - P.start[g]) * width
            scatter_add(P.A, a, 1.0, row, P.cols, begin, width)
            for other in range(g + 1):
                first, many, e = P.begin[other], P.begin[other + 1] - P.begin[other], P.entry[other]
                for k in range(P.start[other], P.start[other + 1]):
                    s = gather_dot(P.A, e, row, P.cols, first, many)
                    e += many
                    G[i * n + k] = G[k * n + i] = s
            for j in range(width):
                row[P.cols[begin + j]] = 0.0
            G[i * (n + 1)] += P.c[i]
