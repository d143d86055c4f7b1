"""Collisions one after another within a step: contacts that are hit through others across a gap that is still open.

The problem of a step takes all contacts at once. A contact that closes only through the collision of others would then
merely be kept from closing, and its own restitution would be lost. Therefore it is left out first, and collides in the
next phase of the same step, starting from the velocity at the end of the first phase.
"""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones import BILATERAL, BOX, CONE
from impactlaw.solvers.cones.algebra.loops import cleared, kernel, plain, put
from impactlaw.solvers.cones.rows import trees_of
from impactlaw.stepping.time_stepping.problem.energy import row_velocities
from impactlaw.stepping.time_stepping.problem.rows import NEAR, Rows, is_length
from impactlaw.stepping.time_stepping.problem.targets import joins
from impactlaw.stepping.time_stepping.tolerances import RESOLVED


@plain
def _is_struck(rows, z, x, g, slowest, resolved):
    sparse, value, rates, row = rows.sparse, rows.value, rows.rates, rows.groups[0, g]
    least, most = (slowest[0], resolved) if is_length(rows, g) else (slowest[1], min(resolved, RESOLVED))
    threshold = max(least, min(rates[1, row] - rates[2, row], most))  # up to it, forces explain the velocity
    if not x[row] > 0.0 or (rows.amounts[0, g] <= NEAR and rates[1, row] <= threshold):
        return False
    velocity = rates[1, row]
    for a in range(sparse[1, row], sparse[1, row] + sparse[0, row]):
        velocity += value[a] * (z[rows.colind[a]] - value[a] * x[row])
    return velocity < -threshold


@plain
def _meets(rows, row, struck):
    """Return whether a row moves a degree of freedom of a contact that is struck later."""
    meets = False
    for a in range(rows.sparse[1, row], rows.sparse[1, row] + rows.sparse[0, row]):
        meets = meets or struck[rows.colind[a]]
    return meets


@kernel
def find_later(rows, z, x, collides, slowest, resolved, later):
    """Find contacts that are hit only through the collision of others; return whether there are any.

    Such a contact is open or opening, and without its own impulse it would approach faster than forces account for.
    Open contacts beside it without impulses are left out with it; otherwise each contact of a face would be, one after
    another.

    Args:
        rows: see `rows.Rows`.
        z: whitened change of velocity by all impulses, (nv,).
        x: impulses, in units of the problem, (n,).
        collides: which groups collide, bool (g,).
        slowest: see `targets.aim`.
        resolved: see `targets.aim`.
        later: the contacts found, bool (g,), written.
    """
    some, struck, groups, sparse = False, cleared(len(z)), rows.groups, rows.sparse
    for g in range(len(collides)):
        later[g], row = False, groups[0, g]
        if groups[2, g] == CONE and not collides[g]:
            later[g] = _is_struck(rows, z, x, g, slowest, resolved)
        if later[g]:
            some = True
            for a in range(sparse[1, row], sparse[1, row] + sparse[0, row]):
                struck[rows.colind[a]] = True
    if some:
        for g in range(len(collides)):
            row = groups[0, g]
            idle = groups[2, g] == CONE and not collides[g] and x[row] == 0.0
            later[g] = later[g] or (idle and rows.amounts[0, g] > NEAR and _meets(rows, row, struck))
    return some


@kernel
def later_rates(rows, z):
    """Return the rates of rows, see `rows.Rows`, in the next phase, which starts with the final velocity of this one.

    Half of the effect of forces in the step comes before all its phases and half after them. Therefore a phase changes
    the velocity before and the velocity without contact alike. Equality constraints keep their velocity in a collision.
    """
    rates, groups, after = rows.rates, rows.groups, np.empty(rows.rates.shape[1])
    row_velocities(rows, z, after)
    new = rates.copy()
    put(new[2], after)
    for r in range(len(after)):
        new[1, r] += after[r] - rates[2, r]
    for g in range(groups.shape[1]):
        if groups[2, g] == BILATERAL:
            new[3, groups[0, g]] = after[groups[0, g]]
    return new


@kernel
def some_groups(rows, keep):
    """Return the rows of the groups to keep, bool (g,), and the index of each among all rows, (n,)."""
    sparse, groups, rates, many, entries, count = rows.sparse, rows.groups, rows.rates, 0, 0, 0
    for g in range(len(keep)):
        if keep[g]:
            count += 1
            many += groups[1, g]
            for r in range(groups[0, g], groups[0, g] + groups[1, g]):
                entries += sparse[0, r]
    place, keys = np.empty(many, np.int64), np.empty(count, np.int64)
    table, new = np.empty((3, many), np.int32), np.empty((len(rates), many))
    columns, values = np.empty(entries, np.int32), np.empty(entries)
    kinds, gaps = np.empty((4, count), np.int32), np.empty((2, count))
    i, r, end = 0, 0, 0
    for g in range(len(keep)):
        if not keep[g]:
            continue
        keys[i] = rows.key[g]
        for k in range(4):
            kinds[k, i] = groups[k, g]
        for k in range(2):
            gaps[k, i] = rows.amounts[k, g]
        kinds[0, i] = r
        for old in range(groups[0, g], groups[0, g] + groups[1, g]):
            place[r] = old
            table[0, r], table[2, r] = sparse[0, old], sparse[2, old]
            for k in range(len(rates)):
                new[k, r] = rates[k, old]
            table[1, r] = end
            for a in range(sparse[1, old], sparse[1, old] + sparse[0, old]):
                columns[end], values[end] = rows.colind[a], rows.value[a]
                end += 1
            r += 1
        i += 1
    return Rows(table, columns, values, kinds, keys, gaps, new), place


@kernel
def reached_by(rows, tree, later):
    """Return which groups take part in the next phase, bool (g,): those that impulses of its contacts can reach.

    Impulses reach through the kinematic trees that groups share. Dry friction is left out: its force is bounded and has
    no effect in an instant.

    Args:
        rows: see `rows.Rows`.
        tree: tree of each degree of freedom, (nv,).
        later: contacts that are hit in the next phase, bool (g,).
    """
    mark, reached, more = cleared(trees_of(tree)), np.zeros(len(later), np.bool_), True
    while more:
        more = False
        for g in range(len(later)):
            if not reached[g] and rows.groups[2, g] != BOX and joins(rows, tree, g, mark, later[g]):
                reached[g] = more = True
    return reached
