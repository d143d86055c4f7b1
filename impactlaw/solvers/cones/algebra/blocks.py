"""The matrix ``H = I + A^T W A`` of an island: assembly, LU factors by blocks of trees, and solution.

W has one m x m block per group. Rows are exchanged only within diagonal blocks. An island of few degrees of freedom is
one block; the factorization is then a dense LU.
"""

import numpy as np

from impactlaw.solvers.cones.algebra.linear import lu_factor, lu_solve, lu_solve_rows
from impactlaw.solvers.cones.algebra.loops import (
    FIRST,
    ONE,
    Array,
    add_at,
    add_products,
    dot,
    fill,
    indices,
    kernel,
    plain,
    subtract,
)
from impactlaw.solvers.cones.algebra.ordering import Blocks
from impactlaw.solvers.cones.algebra.structure import Island, jump, rows_times


@plain
def _find_runs(K: Blocks, begin: int, width: int, runs: Array) -> int:
    """Write the starts of runs of a group's columns that are adjacent in a block; return the number of runs."""
    count = 0
    for j in range(begin, begin + width):
        if j == begin or K.slot[j] != K.slot[j - 1] or K.inner[j] != K.inner[j - 1] + np.uint64(1):
            runs[count] = j - begin
            count += 1
    runs[count] = width
    return count


@plain
def _add_to_blocks(P: Island, K: Blocks, W: Array, H: Array, left: Array, runs: Array, g: int) -> None:
    """Add the contribution of a group to a matrix of many blocks."""
    m, begin, a = P.start[g + 1] - P.start[g], P.begin[g], P.entry[g]
    width, count = P.begin[g + 1] - begin, _find_runs(K, begin, P.begin[g + 1] - begin, runs)
    fill(left, FIRST, m * width, 0.0)
    add_products(left, FIRST, width, W, P.square[g], m, ONE, m, P.A, a, width, width, m)
    for s in range(count):
        i = runs[s]
        q = K.first[g] + K.slot[begin + i] * K.many[g]
        for r in range(count):
            j = runs[r]
            t = q + K.slot[begin + j]
            base = K.place[t] + np.int64(K.inner[begin + i]) * K.pitch[t] + np.int64(K.inner[begin + j])
            add_products(
                H, base, K.pitch[t], P.A, a + i, ONE, width, runs[s + 1] - i, left, j, width, runs[r + 1] - j, m
            )  # fmt: skip


@plain
def _add_to_one(P: Island, K: Blocks, W: Array, H: Array, left: Array, row: Array, g: int) -> None:
    """Add the contribution of a group to a matrix of one block."""
    m, begin, a = P.start[g + 1] - P.start[g], P.begin[g], P.entry[g]
    width, w = P.begin[g + 1] - begin, P.square[g]
    for k in range(m):
        fill(left, k * width, width, 0.0)
        for i in range(m):
            f = W[w + k * m + i]
            if f != 0.0:
                subtract(left, k * width, P.A, a + i * width, -f, width)
    for i in range(width):
        fill(row, FIRST, width, 0.0)
        for k in range(m):
            f = P.A[a + k * width + i]
            if f != 0.0:
                subtract(row, FIRST, left, k * width, -f, width)
        add_at(H, np.int64(K.inner[begin + i]) * K.width[0], row, K.inner, begin, width)


@kernel
def assemble(P: Island, K: Blocks, W: Array, H: Array, left: Array, row: Array) -> None:
    """Write ``H = I + A^T W A``, W in the order of `Island.square`; `left` and `row`: room for m k and k numbers."""
    runs = indices(P.nv + 1)
    fill(H, FIRST, K.size, 0.0)
    for k in range(len(K.width)):
        for i in range(K.width[k]):
            H[K.diagonal[k] + i * (K.width[k] + 1)] = 1.0
    for g in range(len(P.kind)):
        if len(K.width) == 1:
            _add_to_one(P, K, W, H, left, row, g)
        else:
            _add_to_blocks(P, K, W, H, left, runs, g)


@plain
def factor(K: Blocks, H: Array, pivot: Array, product: Array) -> None:
    """Factor H in place; `product` is room for one row of a strip."""
    for k in range(len(K.width)):
        w, span = K.width[k], K.span[k]
        lu_factor(H, K.diagonal[k], w, pivot, K.offset[k])
        if span == 0:
            continue
        lu_solve_rows(H, K.diagonal[k], w, pivot, K.offset[k], H, K.upper[k], span)
        row, begin, end = K.lower[k], K.begin[k], K.begin[k + 1]
        for a in range(end - begin):
            for i in range(K.width[K.later[begin + a]]):
                fill(product, FIRST, span, 0.0)
                for q in range(w):
                    if H[row + q] != 0.0:
                        subtract(product, FIRST, H, K.upper[k] + q * span, -H[row + q], span)
                row += w
                at = 0
                for b in range(end - begin):
                    q = K.pair[k] + a * (end - begin) + b
                    base, many = K.target[q] + i * K.stride[q], K.width[K.later[begin + b]]
                    subtract(H, base, product, at, 1.0, many)
                    at += many


@plain
def solve(K: Blocks, H: Array, pivot: Array, v: Array) -> None:
    """Overwrite v by ``H^-1 v``; H is factored."""
    nb = len(K.width)
    for k in range(nb):
        w, o = K.width[k], K.offset[k]
        lu_solve(H, K.diagonal[k], w, pivot, o, v, o)
        row = K.lower[k]
        for a in range(K.begin[k], K.begin[k + 1]):
            j = K.later[a]
            for i in range(K.offset[j], K.offset[j] + K.width[j]):
                v[i] -= dot(H, row, v, o, w)
                row += w
    for k in range(nb - 1, -1, -1):
        o = K.offset[k]
        for i in range(K.width[k]):
            at, s = K.upper[k] + i * K.span[k], v[o + i]
            for a in range(K.begin[k], K.begin[k + 1]):
                j = K.later[a]
                s -= dot(H, at, v, K.offset[j], K.width[j])
                at += K.width[j]
            v[o + i] = s


@plain
def back_substitute(P: Island, K: Blocks, E: Array, H: Array, pivot: Array, z: Array, w: Array, step: Array) -> None:
    """Overwrite a `step` E q by ``E (q - A dz)`` with ``H dz = A^T E q``; H is factored, z and w are scratch arrays."""
    jump(P, step, z)
    solve(K, H, pivot, z)
    rows_times(P, z, w)
    for g in range(len(P.kind)):
        o, at = P.start[g], P.square[g]
        m = P.start[g + 1] - o
        for k in range(m):
            for j in range(m):
                step[o + k] -= E[at + k * m + j] * w[o + j]


@plain
def room(P: Island) -> int:
    """Return the largest number of entries of a group, or nv if that is larger."""
    most = P.nv
    for g in range(len(P.kind)):
        most = max(most, P.entry[g + 1] - P.entry[g])
    return most


@plain
def flops(P: Island, K: Blocks) -> float:
    """Return an estimate of the operations of one assembly, factorization and line search."""
    s = K.flops + 4.0 * K.size
    for g in range(len(P.kind)):
        k = P.begin[g + 1] - P.begin[g]
        s += 2.0 * (P.entry[g + 1] - P.entry[g]) * (k + 8)
    return s + 100.0
