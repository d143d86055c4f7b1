"""The rows of one step: MuJoCo's constraint rows, whitened and grouped into contacts, limits, equalities, dry friction.

The mass matrix of a step is the one of its integrator, ``M_h = M + h B`` where damping B is implicit, which MuJoCo
keeps as ``M_h = L^T D L``. A row of ``Y = J L^-1 D^-1/2`` is the gradient where the kinetic metric of the step is the
Euclidean one: ``Y Y^T = J M_h^-1 J^T``, the Delassus matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.scene.tolerances import NO_FRICTION
from impactlaw.solvers.cones import BILATERAL, BOX, CONE
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.compiled.whitening import whiten

NEAR = 1e-5
"""Gap, m or rad, up to which a contact takes part whatever its velocity."""

_EQUALITY, _LOSS, _LIMIT, _ELLIPTIC = 0, (1, 2), (3, 4), 7  # mjtConstraint


class Rows(NamedTuple):
    """The rows of a step, group by group; a group is a contact, a limit, a row of an equality or of dry friction.

    Attributes:
        sparse: entries of each row of Y, where they begin, and MuJoCo's row, int32 (3, n).
        colind: degrees of freedom of the entries, int32.
        value: the entries.
        groups: first row, number of rows, kind (`BILATERAL`, `BOX`, `CONE`) and source of each group, int32 (4, g). The
            source is the number of a contact among MuJoCo's, ``-2 - row`` for a limit, and -1 for anything else.
        key: what tells a group from others from step to step, int64 (g,).
        amounts: of each group the gap, m or rad, and the largest impulse of dry friction, N s, (2, g).
        rates: of each row, (5, n): the coefficient of friction of a row of friction, else 1; ``J v``, the velocity at
            the start of the step, m/s or rad/s; ``J v_free``, to which the forces without contact lead; the velocity
            at which an equality is met; and its compliance R, 0 for what is rigid.
    """

    sparse: np.ndarray
    colind: np.ndarray
    value: np.ndarray
    groups: np.ndarray
    key: np.ndarray
    amounts: np.ndarray
    rates: np.ndarray

    @property
    def first(self) -> np.ndarray:
        """First row of each group, int32 (g,)."""
        return self.groups[0]

    @property
    def size(self) -> np.ndarray:
        """Rows of each group, int32 (g,)."""
        return self.groups[1]

    @property
    def kind(self) -> np.ndarray:
        """Kind of each group, int32 (g,)."""
        return self.groups[2]

    @property
    def source(self) -> np.ndarray:
        """Source of each group, int32 (g,)."""
        return self.groups[3]

    @property
    def gap(self) -> np.ndarray:
        """Gap of each group, m or rad, (g,)."""
        return self.amounts[0]

    @property
    def row(self) -> np.ndarray:
        """MuJoCo's row of each row, int32 (n,)."""
        return self.sparse[2]

    @property
    def scale(self) -> np.ndarray:
        """Coefficient of friction of rows of friction, else 1, (n,)."""
        return self.rates[0]

    @property
    def before(self) -> np.ndarray:
        """``J v``, (n,)."""
        return self.rates[1]

    @property
    def free(self) -> np.ndarray:
        """``J v_free``, (n,)."""
        return self.rates[2]

    @property
    def compliance(self) -> np.ndarray:
        """R of soft equalities, else 0, (n,)."""
        return self.rates[4]


@plain
def _group(kinds, address, dim, friction, number, row, frictional):
    """Return the kind of the group that begins at a row, and its rows, those without friction left out."""
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
            rows += friction[contact, k] > NO_FRICTION
    return CONE, rows, dim[contact]


@plain
def _is_near(row, position, Jnnz, Jadr, Jcol, J, one, other, reach):
    if position[row] <= NEAR:
        return True
    first, second = 0.0, 0.0
    for k in range(Jadr[row], Jadr[row] + Jnnz[row]):
        first += J[k] * one[Jcol[k]]
        second += J[k] * other[Jcol[k]]
    return position[row] + reach * min(first, second) < 0.0


@compiled(
    "(int32[::1],float64[::1],int32[::1],int32[::1],int32[::1],float64[::1],int32[:],float64[::1],float64[::1],float64)"
)
def near_rows(kinds, position, Jnnz, Jadr, Jcol, J, address, one, other, reach):
    """Return which of MuJoCo's rows begin a contact or limit that is in touch, or would be soon, bool (nefc,).

    That is, ``gap + reach min(J v, 0) < 0`` with one of two velocities. Rows of anything else are among them.

    Args:
        kinds: of rows, (nefc,).
        position: gaps, (nefc,).
        Jnnz: entries of rows of J.
        Jadr: where they begin.
        Jcol: their degrees of freedom.
        J: the entries.
        address: first rows of contacts, (ncon,).
        one: velocity, (nv,).
        other: another one, (nv,).
        reach: time, s.
    """
    near = kinds <= 2
    for row in range(len(kinds)):
        if kinds[row] == 3 or kinds[row] == 4:
            near[row] = _is_near(row, position, Jnnz, Jadr, Jcol, J, one, other, reach)
    for row in address:
        if row >= 0:
            near[row] = _is_near(row, position, Jnnz, Jadr, Jcol, J, one, other, reach)
    return near


@compiled(
    # MuJoCo's arrays of contacts have gaps between entries, but numpy says otherwise where there is only one contact
    "(int32[::1],int32[::1],float64[::1],float64[::1],float64[::1],float64[::1],float64[::1],"
    "int32[::1],int32[::1],int32[::1],float64[::1],int32[:],int32[:],int32[:,:],float64[:,:],"
    "int32[::1],int32[::1],int32[::1],float64[::1],float64[::1],int32[::1],int32[::1],int32[::1],"
    "float64[::1],float64[::1],boolean[::1],float64,boolean)"
)
def read_rows(
    kinds, number, position, velocity, reference, regularizer, loss,
    Jnnz, Jadr, Jcol, J,
    address, dim, geoms, friction,
    Mnnz, Madr, Mcol, factor, inverse, tree, treeadr, treenum,
    before, free, near, timestep, frictional,
):  # fmt: skip
    """Return what `Rows` holds, as a tuple in its order; the arguments are MuJoCo's arrays of now.

    Only groups whose first row is ``near`` take part. Dense rows are given as sparse ones with all entries.
    Without velocities of rows, (0,), those of belts are left out.
    """
    n, nv, ntree = len(kinds), len(before), len(treeadr)
    groups, rows, entries = 0, 0, 0
    row = 0
    keep = np.zeros(n, np.bool_)
    while row < n:
        kind, size, step = _group(kinds, address, dim, friction, number, row, frictional)
        if near[row]:
            keep[row : row + step] = True
            groups += 1
            rows += size
        row += step
    mark = np.zeros(ntree, np.bool_)
    for row in range(n):
        if not keep[row]:
            continue
        for k in range(Jadr[row], Jadr[row] + Jnnz[row]):
            t = tree[Jcol[k]]
            if J[k] != 0.0 and not mark[t]:
                mark[t] = True
                entries += treenum[t]
        for k in range(Jadr[row], Jadr[row] + Jnnz[row]):
            mark[tree[Jcol[k]]] = False
    sparse, table = np.empty((3, rows), np.int32), np.full((4, groups), -1, np.int32)
    key, amounts, rates = np.empty(groups, np.int64), np.zeros((2, groups)), np.zeros((5, rows))
    rownnz, rowadr, place = sparse[0], sparse[1], sparse[2]
    gap, bound = amounts[0], amounts[1]
    scale, was, is_free, rest, compliance = rates[0], rates[1], rates[2], rates[3], rates[4]
    colind, value = np.empty(entries, np.int32), np.empty(entries)
    root, work = np.sqrt(inverse), np.zeros(nv)
    row, g, r, end = 0, 0, 0, 0
    while row < n:
        kind, size, step = _group(kinds, address, dim, friction, number, row, frictional)
        if not keep[row]:
            row += step
            continue
        table[0, g], table[1, g], table[2, g] = r, size, kind
        key[g] = -1 - (np.int64(number[row]) * 8 + kinds[row])
        if kind == BOX:
            bound[g] = timestep * loss[row]
        elif kind == CONE:
            gap[g] = position[row]
            if kinds[row] >= 5:
                table[3, g] = number[row]
                one, other = geoms[number[row], 0], geoms[number[row], 1]
                key[g] = (np.int64(min(one, other)) << 32) + max(one, other)
            else:
                table[3, g] = -2 - row
        for k in range(step):
            if k > 0:
                if not frictional:
                    break
                mu = friction[number[row], k - 1]
                if not mu > NO_FRICTION:
                    continue
                scale[r] = mu
            else:
                scale[r] = 1.0
            i = row + k
            place[r] = i
            if kind == BILATERAL:
                rest[r] = velocity[i] + timestep * reference[i] if len(velocity) > 0 else 0.0
                compliance[r] = regularizer[i]
            rowadr[r] = end
            for a in range(Jadr[i], Jadr[i] + Jnnz[i]):
                was[r] += J[a] * before[Jcol[a]]
                is_free[r] += J[a] * free[Jcol[a]]
            rownnz[r] = whiten(
                Jnnz[i], Jadr[i], Jcol, J, end, work, mark, factor, Mnnz, Madr, Mcol, root, tree, treeadr, treenum,
                value, colind,
            )  # fmt: skip
            for a in range(end, end + rownnz[r]):
                value[a] *= scale[r]
            end += rownnz[r]
            if kind == CONE and len(velocity) > 0:  # MuJoCo's has the velocity of belts in it
                is_free[r] += velocity[i] - was[r]
                was[r] = velocity[i]
            r += 1
        row += step
        g += 1
    return sparse, colind[:end], value[:end], table, key, amounts, rates
