"""Build the scaled problem of one island, with columns in order of elimination, from the rows of a problem."""

import numpy as np

from impactlaw.solvers.cones.algebra.loops import (
    Array,
    cleared,
    counts,
    indices,
    kernel,
    numbers,
    once,
    unsigned,
    zeros,
)
from impactlaw.solvers.cones.algebra.ordering import Blocks, lay_out, least_degree, one_block
from impactlaw.solvers.cones.algebra.structure import Island
from impactlaw.solvers.cones.rows import Problem

_ONE_BLOCK = 48  # largest number of degrees of freedom of an island that is one dense block


@once
def _columns(
    members: Array, problem: Problem, number: Array, seen: Array, begin: Array, cols: Array, dofs: Array
) -> tuple[int, int]:
    """Number the degrees of freedom in order of appearance and list the columns of each group; return both counts."""
    nv = count = 0
    for j in range(len(members)):
        g = members[j]
        for i in range(problem.first[g], problem.first[g] + problem.size[g]):
            for k in range(problem.rowadr[i], problem.rowadr[i] + problem.rownnz[i]):
                d = problem.colind[k]
                if problem.value[k] != 0.0 and seen[d] != g:
                    seen[d] = g
                    if number[d] < 0:
                        number[d] = nv
                        dofs[nv] = d
                        nv += 1
                    cols[count] = number[d]
                    count += 1
        begin[j + 1] = count
    return nv, count


@kernel
def _sort(number: Array, begin: Array, cols: Array, dofs: Array) -> None:
    """Number the degrees of freedom in ascending order, and sort the columns of each group: a tree's are adjacent."""
    low, high, count = dofs[0], dofs[0], 0
    for d in dofs:
        low, high = min(low, d), max(high, d)
    marked = cleared(high + 1 - low)
    for d in dofs:
        marked[d - low] = True
    for i in range(len(marked)):
        if marked[i]:
            number[low + i] = count
            count += 1
    for g in range(len(begin) - 1):
        for k in range(begin[g], begin[g + 1]):
            here, at = number[dofs[cols[k]]], k
            while at > begin[g] and cols[at - 1] > here:
                cols[at] = cols[at - 1]
                at -= 1
            cols[at] = here
    for i in range(len(marked)):
        if marked[i]:
            dofs[number[low + i]] = low + i


@once
def _blocks(tree: Array, dofs: Array, begin: Array, cols: Array) -> Blocks:
    """Return the storage of the matrix, with a block for each tree; `cols` are renumbered in order of elimination."""
    nv, trees, nb = len(dofs), 0, 0
    home, inside, wide = np.empty(nv, np.int64), np.empty(nv, np.int64), np.zeros(nv, np.int64)
    for d in dofs:
        trees = max(trees, tree[d] + 1)
    number = np.full(trees, -1, np.int64)
    for k in range(nv):
        t = tree[dofs[k]]
        if number[t] < 0:
            number[t] = nb
            nb += 1
        home[k] = number[t]
        inside[k] = wide[home[k]]
        wide[home[k]] += 1
    joined = np.zeros((nb, nb), np.bool_)
    if nb > 1:
        for g in range(len(begin) - 1):
            for i in range(begin[g], begin[g + 1]):
                if i == begin[g] or home[cols[i]] != home[cols[i - 1]]:
                    for j in range(begin[g], i):
                        joined[home[cols[i]], home[cols[j]]] = joined[home[cols[j]], home[cols[i]]] = True
    order = np.empty(nb, np.int64)
    least_degree(joined, wide[:nb], order)
    return lay_out(joined, order, wide[:nb], begin, cols, home, inside)


@once
def build(members: Array, problem: Problem, length: Array, number: Array, seen: Array) -> tuple[Island, Blocks]:
    """Return the scaled problem of the groups `members`, and the storage of its matrix.

    `number` and `seen`, (nv,), are scratch arrays filled with -1 at first; the islands of a problem share them.
    """
    groups, first, size = len(members), problem.first, problem.size
    rownnz, rowadr, value = problem.rownnz, problem.rowadr, problem.value
    start, begin = counts(groups + 1), counts(groups + 1)
    entry, square = counts(groups + 1), counts(groups + 1)
    kinds, bounds = indices(groups), numbers(groups)
    count = 0
    for j in range(groups):
        g = members[j]
        start[j + 1] = start[j] + size[g]
        square[j + 1] = square[j] + size[g] ** 2
        kinds[j], bounds[j] = problem.kind[g], problem.bound[g] * length[g]
        for i in range(first[g], first[g] + size[g]):
            count += rownnz[i]
    cols, dofs = indices(count), indices(min(count, len(problem.tree)))
    nv, count = _columns(members, problem, number, seen, begin, cols, dofs)
    cols = cols[:count]
    if nv > _ONE_BLOCK:
        _sort(number, begin, cols, dofs[:nv])
    raw, columns = indices(count), unsigned(count)
    for k in range(count):
        raw[k] = cols[k]
    for j in range(groups):
        entry[j + 1] = entry[j] + (start[j + 1] - start[j]) * (begin[j + 1] - begin[j])
    if nv > _ONE_BLOCK:
        K = _blocks(problem.tree, dofs[:nv], begin, cols)
    else:
        K = one_block(nv, begin, cols)
    for k in range(count):
        number[dofs[raw[k]]] = columns[k] = cols[k]
    position = indices(nv)
    A, compliance, offset = zeros(entry[groups]), numbers(start[groups]), numbers(start[groups])
    for j in range(groups):
        g, width = members[j], begin[j + 1] - begin[j]
        for k in range(width):
            position[cols[begin[j] + k]] = k
        inverse = 1.0 / length[g]
        for m in range(size[g]):
            i, a = first[g] + m, entry[j] + m * width
            compliance[start[j] + m] = problem.compliance[i] * inverse * inverse
            offset[start[j] + m] = problem.b[i] * inverse
            for k in range(rowadr[i], rowadr[i] + rownnz[i]):
                if value[k] != 0.0:
                    A[a + position[number[problem.colind[k]]]] = value[k] * inverse
    return Island(start, kinds, bounds, compliance, offset, begin, columns, entry, A, square, nv, problem.exact), K
