"""Nonlinear elimination: the contacts that are far from solved are solved first, all other impulses held.

In large islands few contacts keep Newton's method from converging: those that begin to stick, to slide, or to touch.
They and their neighbours are a small problem, which is solved as such. After that Newton's method of all contacts is
mostly near enough (Lanzkron, Rose & Wilkes 1996, *An analysis of approximate nonlinear elimination*, SIAM J. Sci.
Comput. 17).
"""

from __future__ import annotations

from typing import NamedTuple

from impactlaw.solvers.cones.algebra.loops import Array, plain
from impactlaw.solvers.cones.rows import group_error

_SHARE = 1e-2  # part of the largest natural map of a group from which others are far from solved, too
_MOST = 0.5  # part of the rows that is still a small problem


class Given(NamedTuple):
    """The rows of all contacts, and the groups of one island; see `solve.solve`.

    Attributes:
        members: groups of the island, int64 (k,).
        rownnz: of all rows, like all that follows.
        rowadr: see there.
        colind: see there.
        value: see there.
        tree: see there.
        first: see there.
        size: see there.
        kind: see there.
        bound: see there.
        compliance: see there.
        b: see there.
        length: of groups, see `rows.lengths`.
    """

    members: Array
    rownnz: Array
    rowadr: Array
    colind: Array
    value: Array
    tree: Array
    first: Array
    size: Array
    kind: Array
    bound: Array
    compliance: Array
    b: Array
    length: Array


@plain
def rows_of(G):
    """Return how many rows the island has."""
    rows = 0
    for g in G.members:
        rows += G.size[g]
    return rows


@plain
def write_errors(G, x, z, error, room):
    """Write the squared natural map of each group of the island, (k,), exact friction; return their sum.

    ``z`` is that of x. There is room for twice the rows of a group.
    """
    total = 0.0
    for j in range(len(G.members)):
        error[j], _ = group_error(
            G.rownnz, G.rowadr, G.colind, G.value, G.first, G.size, G.kind, G.bound, G.compliance, G.b, x, z, True,
            G.length, G.members[j], room,
        )  # fmt: skip
        total += error[j]
    return total


@plain
def _mark_far(G, error, mark):
    """Mark the trees of groups that are far from solved."""
    worst = 0.0
    for e in error:
        worst = max(worst, e)
    for j in range(len(G.members)):
        if error[j] > _SHARE * _SHARE * worst:
            i = G.first[G.members[j]]
            for k in range(G.rowadr[i], G.rowadr[i] + G.rownnz[i]):
                mark[G.tree[G.colind[k]]] = True


@plain
def far_from_solved(G, error, mark, chosen):
    """Write the groups that share a tree with one that is far from solved; return how many, 0 if they are too many.

    Args:
        G: the island.
        error: see `write_errors`.
        mark: trees, all False, and so in the end.
        chosen: room, int64 (k,), written.
    """
    _mark_far(G, error, mark)
    count, rows = 0, 0
    for g in G.members:
        i = G.first[g]
        for k in range(G.rowadr[i], G.rowadr[i] + G.rownnz[i]):
            if mark[G.tree[G.colind[k]]]:
                chosen[count] = g
                count, rows = count + 1, rows + G.size[g]
                break
    for t in range(len(mark)):
        mark[t] = False
    return count if rows <= _MOST * rows_of(G) else 0


@plain
def hold_others(G, chosen, x, z, held, offset):
    """Write the offsets of chosen groups, all other impulses held, to `offset`, (n,); `held` is room, (nv,)."""
    for i in range(len(z)):
        held[i] = z[i]
    for g in chosen:
        for i in range(G.first[g], G.first[g] + G.size[g]):
            for k in range(G.rowadr[i], G.rowadr[i] + G.rownnz[i]):
                held[G.colind[k]] -= G.value[k] * x[i]
    for g in chosen:
        for i in range(G.first[g], G.first[g] + G.size[g]):
            s = G.b[i]
            for k in range(G.rowadr[i], G.rowadr[i] + G.rownnz[i]):
                s += G.value[k] * held[G.colind[k]]
            offset[i] = s
