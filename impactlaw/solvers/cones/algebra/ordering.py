"""The order of elimination of the kinematic trees of an island, and the storage of the blocks of the factors.

The matrix ``H = I + A^T W A`` couples two trees only if a group of rows involves both. Trees are eliminated in the
order of least degree. Fill-in blocks are determined once, for all factorizations of a solve.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import types

from impactlaw.solvers.cones.algebra.loops import (
    INTEGERS,
    UNSIGNED,
    Array,
    counts,
    indices,
    kernel,
    once,
    plain,
    unsigned,
)


class Blocks(NamedTuple):
    """The storage of the blocks of H and of its factors, in order of elimination."""

    width: Array  # number of degrees of freedom of each block, (nb,)
    offset: Array  # first degree of freedom of each block, (nb,)
    diagonal: Array  # storage of each diagonal block, (nb,)
    upper: Array  # storage of the strip to the right of each diagonal block, width x span, (nb,)
    lower: Array  # storage of the strip below each diagonal block, span x width, (nb,)
    span: Array  # width of the strips, (nb,)
    begin: Array  # first entry of each block in `later`, (nb + 1,)
    later: Array  # the blocks of the strips
    pair: Array  # first pair of each block in `target` and `stride`, (nb + 1,)
    target: Array  # storage of the block that each pair of strip blocks updates
    stride: Array  # row stride of that block
    first: Array  # first pair of each group in `place` and `pitch`, (g + 1,)
    many: Array  # number of blocks that each group involves, (g,)
    slot: Array  # index of each column's block among the blocks of its group, in the order of `Island.cols`
    inner: Array  # index of each column inside its block, unsigned, in the order of `Island.cols`
    place: Array  # storage of the block of each pair of blocks of a group
    pitch: Array  # row stride of that block
    size: int  # length of the storage
    flops: float  # estimated operations of one factorization


BLOCKS: Any = types.NamedTuple([INTEGERS] * 14 + [UNSIGNED, INTEGERS, INTEGERS, types.int64, types.float64], Blocks)
"""The type of `Blocks` in compiled code."""


@kernel
def least_degree(joined: Array, width: Array, order: Array) -> None:
    """Write an order of elimination by least degree; `joined` (nb, nb) is overwritten by the graph with its fill."""
    nb = len(width)
    done = np.zeros(nb, np.bool_)
    degree = np.zeros(nb, np.int64)
    near = np.empty(nb, np.int64)
    for i in range(nb):
        for j in range(nb):
            if joined[i, j] and i != j:
                degree[i] += width[j]
    for k in range(nb):
        best = -1
        for i in range(nb):
            if not done[i] and (best < 0 or degree[i] < degree[best]):
                best = i
        order[k] = best
        done[best] = True
        count = 0
        for j in range(nb):
            if joined[best, j] and not done[j]:
                near[count] = j
                count += 1
                degree[j] -= width[best]
        for a in range(count):
            for b in range(count):
                i, j = near[a], near[b]
                if i != j and not joined[i, j]:
                    joined[i, j] = True
                    degree[i] += width[j]


@plain
def _block(i: int, j: int, spot: Array, diagonal: Array, upper: Array, lower: Array, span: Array, width: Array):
    """Return storage and stride of the block (i, j)."""
    if i == j:
        return diagonal[i], width[i]
    if i < j:
        return upper[i] + spot[i, j], span[i]
    return lower[j] + spot[j, i] * width[j], width[j]


@plain
def _fill_one(n: int, begin: Array, cols: Array, first: Array, many: Array, pitch: Array, inner: Array) -> None:
    """Write the fields of `Blocks` about groups and columns, for a matrix of one block."""
    for g in range(len(many)):
        many[g] = 1 if begin[g + 1] > begin[g] else 0
        first[g + 1] = first[g] + many[g]
        pitch[g] = n
    for j in range(len(cols)):
        inner[j] = cols[j]


@once
def one_block(n: int, begin: Array, cols: Array) -> Blocks:
    """Return the storage of a matrix of one block, (n, n); it has the lifetime of the calling function."""
    groups, count = len(begin) - 1, len(cols)
    first, many, place, pitch = counts(groups + 1), indices(groups), counts(groups), indices(groups)
    few, slot, inner = counts(4), counts(count), unsigned(count)
    few[0], few[1] = n, n * n
    _fill_one(n, begin, cols, first, many, pitch, inner)
    width, square, zero, zeros, none = few[:1], few[1:2], few[2:3], few[2:], few[:0]
    return Blocks(
        width, zero, zero, square, square, zero, zeros, none, zeros, none, none, first, many, slot, inner, place, pitch,
        n * n, n * n * n / 1.5,
    )  # fmt: skip


@kernel
def lay_out(joined: Array, order: Array, wide: Array, begin: Array, cols: Array, home: Array, inside: Array) -> Blocks:
    """Return the storage of the blocks.

    Args:
        joined: graph of the trees with its fill-in, (nb, nb).
        order: the tree eliminated in each step, (nb,).
        wide: number of degrees of freedom of each tree, (nb,).
        begin: first column of each group, (g + 1,).
        cols: columns of the groups; renumbered in order of elimination.
        home: tree of each column, (nv,).
        inside: index of each column inside its tree, (nv,).
    """
    nb, groups = len(order), len(begin) - 1
    width, offset, span = np.empty(nb, np.int64), np.empty(nb, np.int64), np.zeros(nb, np.int64)
    position = np.empty(nb, np.int64)
    edges = at = 0
    for k in range(nb):
        position[order[k]] = k
        width[k], offset[k] = wide[order[k]], at
        at += width[k]
    spot = np.full((nb, nb), -1, np.int64)
    for k in range(nb):
        for j in range(k + 1, nb):
            if joined[order[k], order[j]]:
                spot[k, j] = span[k]
                span[k] += width[j]
                edges += 1
    diagonal, upper, lower = np.empty(nb, np.int64), np.empty(nb, np.int64), np.empty(nb, np.int64)
    start, pair, later = np.zeros(nb + 1, np.int64), np.zeros(nb + 1, np.int64), np.empty(edges, np.int64)
    size, flops, count = 0, 0.0, 0
    for k in range(nb):
        w, s = width[k], span[k]
        diagonal[k], upper[k], lower[k] = size, size + w * w, size + w * w + w * s
        size += w * w + 2 * w * s
        flops += w * w * w / 1.5 + 2.0 * w * w * s + 2.0 * w * s * s
        for j in range(k + 1, nb):
            if spot[k, j] >= 0:
                later[count] = j
                count += 1
        start[k + 1] = count
        pair[k + 1] = pair[k] + (count - start[k]) ** 2
    target, stride = np.empty(pair[nb], np.int64), np.empty(pair[nb], np.int64)
    q = 0
    for k in range(nb):
        for a in range(start[k], start[k + 1]):
            for b in range(start[k], start[k + 1]):
                target[q], stride[q] = _block(later[a], later[b], spot, diagonal, upper, lower, span, width)
                q += 1
    first, many = np.zeros(groups + 1, np.int64), np.zeros(groups, np.int64)
    slot, inner = np.empty(len(cols), np.int64), np.empty(len(cols), np.int64)
    touched = np.empty(len(cols), np.int64)
    total = 0
    for g in range(groups):  # the blocks of each group, stored in `touched` from begin[g] on
        for j in range(begin[g], begin[g + 1]):
            k, inner[j] = position[home[cols[j]]], inside[cols[j]]
            new = True
            for t in range(many[g]):
                if touched[begin[g] + t] == k:
                    slot[j], new = t, False
            if new:
                slot[j] = many[g]
                touched[begin[g] + many[g]] = k
                many[g] += 1
            cols[j] = offset[k] + inner[j]
        total += many[g] ** 2
        first[g + 1] = total
    place, pitch = np.empty(total, np.int64), np.empty(total, np.int64)
    for g in range(groups):
        q = first[g]
        for a in range(many[g]):
            for b in range(many[g]):
                i, j = touched[begin[g] + a], touched[begin[g] + b]
                place[q], pitch[q] = _block(i, j, spot, diagonal, upper, lower, span, width)
                q += 1
    return Blocks(
        width, offset, diagonal, upper, lower, span, start, later, pair, target, stride, first, many, slot,
        inner.astype(np.uint64), place, pitch, size, flops,
    )  # fmt: skip
