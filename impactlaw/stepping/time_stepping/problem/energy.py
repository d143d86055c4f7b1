"""The energy balance of the impulses of a step, and the part of the impulses that adds no energy."""

from __future__ import annotations

from typing import Any

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import indices, kernel, numbers, plain, zeros
from impactlaw.solvers.cones.rows import impulse_jump, islands
from impactlaw.stepping.time_stepping import tolerances

CREATED = 1e-9  # part of the sum of the sizes of contact energies up to which created energy is rounding
_ROUNDING = 1e-14  # rounding, as a part of a sum of energies


is_met: Any = plain(tolerances.is_met)


@plain
def row_velocities(rows, z, after):
    """Write the velocity of each row after impulses that change the whitened velocity by z, (n,)."""
    sparse, colind, value, rates = rows.sparse, rows.colind, rows.value, rows.rates
    for r in range(len(after)):
        s = 0.0
        for a in range(sparse[1, r], sparse[1, r] + sparse[0, r]):
            s += value[a] * z[colind[a]]
        after[r] = rates[2, r] + s / rates[0, r]


@plain
def add_before(rows, jacobian, moved):
    """Add a velocity before the collision, (nv,), to that of each row; see `inertial_forces`."""
    nnz, adr, col, J = jacobian
    for r in range(rows.rates.shape[1]):
        row = rows.sparse[2, r]
        for a in range(adr[row], adr[row] + nnz[row]):
            rows.rates[1, r] += J[a] * moved[col[a]]


@plain
def add_work(rows, base, after, x, g, work, total):
    """Add ``Lambda^T (gamma + gamma+) / 2`` of a group, for given gamma, and the sizes of its terms, to the sums."""
    for k in range(rows.groups[0, g], rows.groups[0, g] + rows.groups[1, g]):
        impulse = 0.5 * x[k] * rows.rates[0, k]
        work += impulse * (base[k] + after[k])
        total += abs(impulse) * (abs(base[k]) + abs(after[k]))
    return work, total


@plain
def work_since(rows, base, after, x):
    """Return ``Lambda^T (gamma + gamma+) / 2`` of all contacts, for given gamma, and the sum of sizes of its terms."""
    work, total = 0.0, 0.0
    for g in range(rows.groups.shape[1]):
        if rows.groups[2, g] == CONE:
            work, total = add_work(rows, base, after, x, g, work, total)
    return work, total


@plain
def contact_work(rows, after, x):
    """Return ``Lambda^T (gamma- + gamma+) / 2`` of all contacts, J, and the sum of the sizes of its terms."""
    return work_since(rows, rows.rates[1], after, x)


@plain
def creates(rows, after, x):
    """Return whether contacts add energy to both the motion before and that without contact: no friction law does.

    One of the two alone is possible: through friction that turns a body around, or through restitution where forces
    push bodies apart.
    """
    work, total = contact_work(rows, after, x)
    if work <= CREATED * total:
        return False
    work, total = work_since(rows, rows.rates[2], after, x)
    return work > CREATED * total


@plain
def _add_sums(rows, after, reached, x, label, sums):
    """Add the sums that `_shares` needs, for each island, (6, islands)."""
    groups, rates = rows.groups, rows.rates
    for g in range(groups.shape[1]):
        if label[g] < 0:
            continue
        island, row = label[g], groups[0, g]
        cone = groups[2, g] == CONE
        if cone:
            sums[4, island] = max(sums[4, island], reached[g] - after[row])
        for k in range(row, row + groups[1, g]):
            impulse = x[k] * rates[0, k]
            sums[0, island] += impulse * rates[2, k]
            sums[1, island] += 0.5 * impulse * (after[k] - rates[2, k])
            sums[2, island] += abs(impulse) * (abs(rates[2, k]) + abs(after[k]))
            if cone:
                sums[3, island] += 0.5 * impulse * (rates[1, k] + after[k])
                sums[5, island] = max(sums[5, island], abs(rates[1, k]), abs(rates[2, k]))


@plain
def _shares(sums, unsolved, share):
    """Write the share of the impulses of each island, at most 1, with which it gains nothing on its free motion.

    The share s of x changes its kinetic energy by ``s x^T J v_free + s^2 x^T (J v+ - J v_free) / 2``. An island that
    meets the law keeps all its impulses, except in an unsolved problem in which contact adds energy. Return whether
    some share is less than 1.
    """
    some = False
    for i in range(len(share)):
        linear, square, total, work, missed, fastest = sums[:, i]
        share[i] = 1.0
        gains = linear + square > CREATED * square + _ROUNDING * total  # impulses that cancel each other can be huge
        if gains and (not is_met(missed, fastest) or (unsolved and work > CREATED * total)):
            share[i] = max(0.0, -linear / square) if square > 0.0 else 0.0
            some = True
    return some


@kernel
def find_islands(rows, tree, label):
    """Write the island of each group, -1 for a group that cannot move; return the number of islands.

    `tree`, (nv,), tells which degrees of freedom belong together: those of a kinematic tree, or each only to itself.
    """
    sparse, groups, length = rows.sparse, rows.groups, numbers(len(label))
    return islands(
        sparse[0], sparse[1], rows.colind, rows.value, tree, groups[0], groups[1], rows.rates[4], length, label
    )


@compiled()
def islands_of(rows, tree):
    """Return the islands of groups, (g,), and of degrees of freedom, (nv,), -1 for none; see `find_islands`."""
    sparse, groups = rows.sparse, rows.groups
    label, of_tree = np.empty(groups.shape[1], np.int64), indices(len(tree))
    island = np.empty(len(tree), np.int64)
    find_islands(rows, tree, label)
    of_tree[:] = -1
    for g in range(len(label)):
        for r in range(groups[0, g], groups[0, g] + groups[1, g] if label[g] >= 0 else groups[0, g]):
            for a in range(sparse[1, r], sparse[1, r] + sparse[0, r]):
                if rows.value[a] != 0.0:
                    of_tree[tree[rows.colind[a]]] = label[g]
    for i in range(len(tree)):
        island[i] = of_tree[tree[i]]
    return label, island


@kernel
def lose_energy(rows, reached, tree, unsolved, x, z, after):
    """Reduce impulses of islands that do not solve their problem and gain energy: such impulses can be arbitrary.

    Impulses x, the whitened jump z and the velocities of rows after it are written. If the problem is `unsolved`,
    contact must not add energy; in a solved problem it may, together with other forces.
    """
    groups, many = rows.groups, rows.groups.shape[1]
    label = indices(many)
    count = find_islands(rows, tree, label)
    sums, share = zeros(6 * count).reshape((6, count)), numbers(count)
    _add_sums(rows, after, reached, x, label, sums)
    if not _shares(sums, unsolved, share):
        return
    for g in range(many):
        for k in range(groups[0, g], groups[0, g] + groups[1, g]):
            x[k] *= share[label[g]] if label[g] >= 0 else 1.0
    impulse_jump(rows.sparse[0], rows.sparse[1], rows.colind, rows.value, x, z)
    row_velocities(rows, z, after)
