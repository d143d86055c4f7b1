"""The rows of a step: MuJoCo's rows, whitened and grouped into contacts, limits, equalities and dry friction.

The mass matrix of a step is that of its integrator, ``M_h = M + h B`` with implicit damping B, which MuJoCo keeps as
``M_h = L^T D L``. A row of ``Y = J L^-1 D^-1/2`` is the gradient in coordinates in which the kinetic metric of the step
is the Euclidean one: ``Y Y^T = J M_h^-1 J^T`` is the Delassus matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from impactlaw.solvers.cones.algebra.loops import FLOATS, Array, plain

NEAR = 1e-5
"""Gap, m or rad, up to which a contact takes part at any velocity."""

_FEW = 4000
"""Number of entries up to which they are not counted to find how much memory they need."""


class Known(NamedTuple):
    """Impulses of an earlier step or phase, from which `contact_problem.guess` and `write_recalled` start."""

    groups: Array  # see `Rows`, like the next one, int32 (4, g)
    key: Array  # keys of the groups, int64 (g,)
    scale: Array  # coefficients of friction, (n,)
    impulse: Array  # impulses, in units of the problem, (n,)
    turns: Array  # the last two of `Rows.rates`, (2, n)


class Rows(NamedTuple):
    """The rows of a step, group by group; a group is a contact, a limit, or a row of an equality or of dry friction."""

    sparse: np.ndarray  # number of entries of each row of Y, index of the first entry, and MuJoCo's row, int32 (3, n)
    colind: np.ndarray  # degree of freedom of each entry, int32
    value: np.ndarray  # the entries
    # first row, number of rows, kind (`BILATERAL`, `BOX`, `CONE`) and source of each group, int32 (4, g). The source is
    # the index of a contact among MuJoCo's, ``-2 - row`` for a limit, and -1 for other groups
    groups: np.ndarray
    key: np.ndarray  # identifies a group from step to step, int64 (g,)
    # for each group the gap, m or rad, and a second number, (2, g): the largest impulse, N s, of dry friction, or the
    # compliance of an equality that does not keep its velocity in a collision
    amounts: np.ndarray
    # for each row, (7, n): the coefficient of friction of a friction row, else 1; ``J v``, the velocity at the start of
    # the step, m/s or rad/s; ``J v_free``, the velocity without contact; the velocity at which an equality is
    # satisfied; its compliance R, 0 for rigid rows; and t and d of the last step, see `gradient_turns`, NaN if there
    # are none
    rates: np.ndarray

    first = property(lambda self: self.groups[0], doc="First row of each group, int32 (g,).")
    size = property(lambda self: self.groups[1], doc="Number of rows of each group, int32 (g,).")
    source = property(lambda self: self.groups[3], doc="Source of each group, int32 (g,).")
    gap = property(lambda self: self.amounts[0], doc="Gap of each group, m or rad, (g,).")
    row = property(lambda self: self.sparse[2], doc="MuJoCo's row for each row, int32 (n,).")
    scale = property(lambda self: self.rates[0], doc="Coefficient of friction of friction rows, else 1, (n,).")
    before = property(lambda self: self.rates[1], doc="``J v``, (n,).")
    compliance = property(lambda self: self.rates[4], doc="R of soft equalities, else 0, (n,).")


_INTS, _TABLE, _INT_TABLE = types.int32[::1], types.float64[:, ::1], types.int32[:, ::1]
JACOBIAN = types.Tuple((_INTS, _INTS, _INTS, FLOATS))
ROWS = types.NamedTuple([_INT_TABLE, _INTS, FLOATS, _INT_TABLE, types.int64[::1], _TABLE, _TABLE], Rows)
KNOWN = types.NamedTuple([_INT_TABLE, types.int64[::1], FLOATS, FLOATS, _TABLE], Known)
"""The types of a Jacobian, `Rows` and `Known` in compiled code."""


@plain
def is_length(rows, g):
    """Return whether the gap of a group is a length: that of a contact or of a tendon.

    Limits of joints count as angles. Keys of limits of tendons are odd, see `impulses.rows`.
    """
    return rows.groups[3, g] >= 0 or rows.key[g] & 1 != 0


@plain
def find_group(key, known_key, at):
    """Return the index of the group of another step that has this key, or -1.

    The search begins at the place after the last match, so that groups with equal keys are matched in order.
    """
    m = len(known_key)
    for step in range(m):
        j = at + step if at + step < m else at + step - m
        if known_key[j] == key:
            return j
    return -1


@plain
def entries_of(jacobian, trees, mark):
    """Return a bound on the number of entries of all rows after whitening; ``mark`` is False for each tree."""
    entries, (nnz, adr, col, J), (tree, _, many) = 0, jacobian, trees
    if len(nnz) * len(tree) <= _FEW:
        return len(nnz) * len(tree)
    for row in range(len(nnz)):
        for k in range(adr[row], adr[row] + nnz[row]):
            t = tree[col[k]]
            if J[k] != 0.0 and not mark[t]:
                mark[t] = True
                entries += many[t]
        for k in range(adr[row], adr[row] + nnz[row]):
            mark[tree[col[k]]] = False
    return entries
