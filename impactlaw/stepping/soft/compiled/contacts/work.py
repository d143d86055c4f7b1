"""The work of each contact in a collision, and distant effects, in compiled code."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import indices, integers, kernel, numbers, plain, zeros
from impactlaw.solvers.cones.rows import islands


@plain
def work_of_each(rows, members, x, z, before, smallest, done):
    """Write the work of each contact of a collision, J, and return whether one of them has a distant effect.

    Args:
        rows: the whitened rows.
        members: contacts that take part, int64 (k,).
        x: impulses of all rows, (n,).
        z: whitened velocity jump, (nv,).
        before: velocities of rows before the collision, (n,).
        smallest: whitened velocity up to which an impulse or a mean velocity is rounding.
        done: the work, (k,), written.
    """
    distant = False
    for j in range(len(members)):
        g, own = members[j], 0.0
        first = rows.first[g]
        for r in range(first, first + rows.sizes[g]):
            mean, length = before[r], 0.0
            for a in range(rows.adr[r], rows.adr[r] + rows.nnz[r]):
                mean += 0.5 * rows.val[a] * z[rows.col[a]]
                length += rows.val[a] * rows.val[a]
            own += x[r] * mean
            length = np.sqrt(length)
            distant = distant or (r == first and x[r] * length > smallest and mean > smallest * length)
        done[j] = own
    return distant


@kernel
def most_gained(rows, members, done, allowed, nv):
    """Return the largest work, J, of a group of contacts that influence each other.

    If no group can do more than `allowed`, an upper bound of it that does not exceed `allowed` is returned.

    Args:
        rows: the whitened rows.
        members: contacts that take part, int64 (k,).
        done: work of each contact, (k,).
        allowed: work that may be rounding, J.
        nv: number of degrees of freedom.
    """
    total, k = 0.0, len(members)
    for work in done:
        total += max(work, 0.0)
    if total <= allowed or k == 1:
        return total
    length, label, freedom = numbers(k), indices(k), integers(nv)
    for i in range(nv):
        freedom[i] = i
    first, sizes = rows.first[members], rows.sizes[members]
    compliance = zeros(len(rows.nnz))
    count = islands(rows.nnz, rows.adr, rows.col, rows.val, freedom, first, sizes, compliance, length, label)
    gained, most = zeros(count + 1), 0.0
    for j in range(k):
        gained[label[j]] += done[j]  # the last entry is for contacts that cannot move
    for work in gained:
        most = max(most, work)
    return most
