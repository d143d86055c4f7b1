"""Bodies joined by contacts, limits and equality constraints: an impulse in one island has no effect in another."""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.solvers.cones.rows import root_of

_LOSS = (1, 2)  # mjtConstraint: dry friction, whose force is bounded, has no effect in an instant


@plain
def tree_of(Jnnz, Jadr, Jcol, J, row, tree):
    """Return a tree that one of MuJoCo's rows moves, -1 if it moves none."""
    for a in range(Jadr[row], Jadr[row] + Jnnz[row]):
        if J[a] != 0.0:
            return np.int64(tree[Jcol[a]])
    return np.int64(-1)


@plain
def join_trees(kinds, number, Jnnz, Jadr, Jcol, J, tree, label):
    """Write the first result of `find_islands`."""
    for t in range(len(label)):
        label[t] = t
    if len(label) == 1:
        return
    last = np.int64(-1)
    for row in range(len(kinds)):
        if kinds[row] == _LOSS[0] or kinds[row] == _LOSS[1]:
            continue
        if row == 0 or kinds[row] != kinds[row - 1] or number[row] != number[row - 1]:
            last = np.int64(-1)
        for a in range(Jadr[row], Jadr[row] + Jnnz[row]):
            if J[a] != 0.0:
                t = root_of(label, np.int64(tree[Jcol[a]]))
                if last >= 0:
                    label[t] = root_of(label, last)
                last = root_of(label, t)
    for t in range(len(label)):
        label[t] = root_of(label, t)


@compiled()
def find_islands(kinds, number, Jnnz, Jadr, Jcol, J, tree, many):
    """Return for each tree of bodies one tree that represents its island, int64 (many,).

    Also return this for a tree that each row moves, -1 for a row that moves none, int64 (nefc,).

    Args:
        kinds: kinds of MuJoCo's rows, (nefc,).
        number: constraint or contact that each row belongs to, (nefc,).
        Jnnz: number of entries of each row of J.
        Jadr: index of the first entry of each row.
        Jcol: degree of freedom of each entry.
        J: the entries.
        tree: tree of each degree of freedom, (nv,).
        many: number of trees.
    """
    label, of_row = np.empty(many, np.int64), np.empty(len(kinds), np.int64)
    join_trees(kinds, number, Jnnz, Jadr, Jcol, J, tree, label)
    for row in range(len(kinds)):
        t = tree_of(Jnnz, Jadr, Jcol, J, row, tree)
        of_row[row] = label[t] if t >= 0 else t
    return label, of_row
