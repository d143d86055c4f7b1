"""The rows of a step: MuJoCo's rows, whitened and grouped into contacts, limits, equalities and dry friction.

The mass matrix of a step is that of its integrator, ``M_h = M + h B`` with implicit damping B, which MuJoCo keeps as
``M_h = L^T D L``. A row of ``Y = J L^-1 D^-1/2`` is the gradient in coordinates in which the kinetic metric of the step
is the Euclidean one: ``Y Y^T = J M_h^-1 J^T`` is the Delassus matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from impactlaw.scene.tolerances import NO_FRICTION
from impactlaw.solvers.cones import BILATERAL, BOX, CONE
from impactlaw.solvers.cones.algebra.loops import FLOATS, Array, plain
from impactlaw.stepping.compiled.whitening import whiten
from impactlaw.stepping.time_stepping.problem.tiny_gaps import close_tiny_gaps

NEAR = 1e-5
"""Gap, m or rad, up to which a contact takes part at any velocity."""

_ROUNDED = 1e-13
"""Part of ``|J| |v|`` up to which the velocity of a row is rounding, and 0.

Bodies that touch and fly together have only such velocities, of which a solver makes a hard problem of friction.
"""

_FEW = 4000
"""Number of entries up to which they are not counted to find how much memory they need."""
_EQUALITY, _LOSS, _LIMIT, _ELLIPTIC = 0, (1, 2), (3, 4), 7  # mjtConstraint


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


class Source(NamedTuple):
    """MuJoCo's rows and contacts, from which the rows of a step are read."""

    kinds: Array  # efc_type, (nefc,)
    number: Array  # efc_id, (nefc,)
    position: Array  # efc_pos, m or rad, (nefc,)
    velocity: Array  # efc_vel, m/s or rad/s, (nefc,); (0,) to leave out velocities of belts
    reference: Array  # efc_aref, (nefc,)
    regularizer: Array  # efc_R, (nefc,)
    loss: Array  # efc_frictionloss, (nefc,)
    # number of entries and first entry of each row, degree of freedom of each entry, and the entries
    jacobian: tuple[Array, Array, Array, Array]
    dim: Array  # condim of contacts, (ncon,)
    geoms: Array  # geoms of contacts, (ncon, 2)
    friction: Array  # coefficients of contacts, (ncon, 5)


_INTS, _TABLE, _INT_TABLE = types.int32[::1], types.float64[:, ::1], types.int32[:, ::1]
JACOBIAN = types.Tuple((_INTS, _INTS, _INTS, FLOATS))
ROWS = types.NamedTuple([_INT_TABLE, _INTS, FLOATS, _INT_TABLE, types.int64[::1], _TABLE, _TABLE], Rows)
KNOWN = types.NamedTuple([_INT_TABLE, types.int64[::1], FLOATS, FLOATS, _TABLE], Known)
"""The types of a Jacobian, `Rows` and `Known` in compiled code."""


@plain
def is_length(groups, key, g):
    """Return whether the gap of a group is a length: that of a contact or of a tendon.

    Limits of joints count as angles. Keys of limits of tendons are odd, see `_write_group`.
    """
    return groups[3, g] >= 0 or key[g] & 1 != 0


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
def _group(kinds, dim, friction, number, row, frictional):
    """Return kind, number of rows without those of no friction, and number of MuJoCo's rows of the group at a row."""
    kind = kinds[row]
    if kind == 0:
        return BILATERAL, 1, 1
    if kind <= 2:
        return BOX, 1, 1
    if kind != _ELLIPTIC:
        return CONE, 1, 1
    contact = number[row]
    rows = 1
    if frictional:
        for k in range(dim[contact] - 1):
            rows += not friction[contact, k] <= NO_FRICTION  # NaN counts: the step must fail, not ignore it
    return CONE, rows, dim[contact]


@plain
def _is_near(row, position, jacobian, one, other, reach):
    if position[row] <= NEAR:
        return True
    first, second, (nnz, adr, col, J) = 0.0, 0.0, jacobian
    for k in range(adr[row], adr[row] + nnz[row]):
        first += J[k] * one[col[k]]
        second += J[k] * other[col[k]]
    return position[row] + reach * min(first, second) < 0.0


@plain
def find_near(kinds, position, jacobian, address, one, other, reach, near):
    """Write which of MuJoCo's rows begin a contact or limit that is closed or would soon be, bool (nefc,).

    The condition is ``gap + reach min(J v, 0) < 0`` for one of two velocities. All rows of other kinds are included.

    Args:
        kinds: kinds of the rows, (nefc,).
        position: gaps, (nefc,).
        jacobian: see `Source`.
        address: first rows of contacts, (ncon,).
        one: a velocity, (nv,).
        other: another velocity, (nv,).
        reach: time, s.
        near: written.
    """
    for row in range(len(kinds)):
        near[row] = kinds[row] <= 2
        if kinds[row] == 3 or kinds[row] == 4:
            near[row] = _is_near(row, position, jacobian, one, other, reach)
    for row in address:
        if row >= 0:
            near[row] = _is_near(row, position, jacobian, one, other, reach)


@plain
def count_groups(kinds, number, dim, friction, near, frictional):
    """Return the number of groups that take part, and the number of their rows."""
    groups, rows, row = 0, 0, 0
    while row < len(kinds):
        _, size, step = _group(kinds, dim, friction, number, row, frictional)
        if near[row]:
            groups += 1
            rows += size
        row += step
    return groups, rows


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


@plain
def _side(jacobian, row):
    """Return 2 for a row with a single, positive entry, else 0; this distinguishes both limits of a slide or hinge."""
    entries, side, (nnz, adr, _, J) = 0, 0, jacobian
    for k in range(adr[row], adr[row] + nnz[row]):
        if J[k] != 0.0:
            entries += 1
            side = 2 if J[k] > 0.0 else 0
    return side if entries == 1 else 0


@plain
def _write_group(rows, g, r, row, size, kind, source, timestep):
    """Write everything of a group that begins at one of MuJoCo's rows, except its rows."""
    kinds, number, loss, regularizer = source.kinds, source.number, source.loss, source.regularizer
    rows.groups[0, g], rows.groups[1, g], rows.groups[2, g], rows.groups[3, g] = r, size, kind, -1
    side = _side(source.jacobian, row) if kinds[row] in _LIMIT else 0
    rows.key[g] = -1 - (np.int64(number[row]) * 8 + kinds[row] + side)
    rows.amounts[0, g] = source.position[row] if kind == CONE else 0.0
    rows.amounts[1, g] = timestep * loss[row] if kind == BOX else regularizer[row] if kind == BILATERAL else 0.0
    if kind == CONE and kinds[row] >= 5:
        rows.groups[3, g] = number[row]
        one, other = source.geoms[number[row], 0], source.geoms[number[row], 1]
        rows.key[g] = (np.int64(min(one, other)) << 32) + max(one, other)
    elif kind == CONE:
        rows.groups[3, g] = -2 - row


@plain
def _write_rates(rows, r, i, kind, scale, source, before, free, timestep):
    """Write the rates of one of MuJoCo's rows."""
    (nnz, adr, col, J), velocity = source.jacobian, source.velocity
    was, led, size, some = 0.0, 0.0, 0.0, len(velocity) > 0
    for a in range(adr[i], adr[i] + nnz[i]):
        part = J[a] * free[col[a]]
        was += J[a] * before[col[a]]
        led += part
        size += abs(part)
    if kind == CONE and some:  # MuJoCo's velocity includes that of belts
        led += velocity[i] - was
        was = velocity[i]
    if abs(led) <= _ROUNDED * size:
        led = 0.0
    rows.rates[0, r], rows.rates[1, r], rows.rates[2, r] = scale, was, led
    rows.rates[3, r] = velocity[i] + timestep * source.reference[i] if kind == BILATERAL and some else 0.0
    rows.rates[4, r] = source.regularizer[i] if kind == BILATERAL else 0.0
    rows.rates[5, r] = rows.rates[6, r] = np.nan


@plain
def write_rows(source, inertia, trees, before, free, near, timestep, frictional, touching, mark, room, rows):
    """Write the rows of the groups whose first row is ``near``, and return the number of their entries.

    Bodies at rest touch up to a gap of `touching`, m.

    Args:
        source: MuJoCo's rows and contacts.
        inertia: the mass matrix of the step.
        trees: see `access.layout_of_trees`.
        before: velocity at the start of the step, (nv,).
        free: velocity without contact, (nv,).
        near: rows of MuJoCo that begin a group that takes part, bool (nefc,).
        timestep: h, s.
        frictional: whether rows of friction take part.
        touching: see above.
        mark: scratch space, False for each tree.
        room: scratch space, (2 nv,).
        rows: written.
    """
    root, work, (nnz, adr, col, J) = room[: len(before)], room[len(before) : 2 * len(before)], source.jacobian
    kinds, number, friction = source.kinds, source.number, source.friction
    for i in range(len(before)):
        root[i], work[i] = np.sqrt(inertia.inverse[i]), 0.0
    row, g, r, end = 0, 0, 0, 0
    while row < len(kinds):
        kind, size, step = _group(kinds, source.dim, friction, number, row, frictional)
        if not near[row]:
            row += step
            continue
        _write_group(rows, g, r, row, size, kind, source, timestep)
        for k in range(step if frictional else 1):
            i, scale = row + k, 1.0 if k == 0 else friction[number[row], k - 1]
            if k > 0 and scale <= NO_FRICTION:
                continue
            _write_rates(rows, r, i, kind, scale, source, before, free, timestep)
            many = whiten(nnz[i], adr[i], col, J, end, work, mark, inertia, root, trees, rows.value, rows.colind)
            rows.sparse[0, r], rows.sparse[1, r], rows.sparse[2, r] = many, end, i
            for a in range(end, end + many):
                rows.value[a] *= scale
            end += many
            r += 1
        row += step
        g += 1
    close_tiny_gaps(rows, before, free, inertia, trees[0], touching, root, work)
    return end
