"""The problem of one step: impulses of contacts, limits, equalities and dry friction all at once, and what follows."""

from __future__ import annotations

import numpy as np
from numba import njit

from impactlaw.solvers.cones.solve import solve
from impactlaw.stepping.time_stepping.rows import BILATERAL, CONE, unwhiten
from impactlaw.stepping.time_stepping.targets import offsets

TOLERANCE = 1e-10
"""Natural map, relative to the largest velocity of the problem, that solvers aim at."""

_SEARCHES = 8  # of the share of restitution that creates no energy
_CREATED = 1e-9  # part of the largest energy of a contact, up to which its creation is rounding
_SLOP = 1e-8  # m or rad: overlaps up to this are left to the velocities
_OPENING = 0.2  # m/s or rad/s at which overlaps of the start are opened


@njit(cache=True, error_model="numpy")
def recall(key, size, first, known_key, known_size, known_first, known, scale, known_scale, n):
    """Return the impulses of the step before where the same group has as many rows, else zeros, (n,).

    Groups of one key are matched in their order. The search goes on where the last match was: the order rarely changes.
    """
    x = np.zeros(n)
    m, at = len(known_key), 0
    for g in range(len(key)):
        for step in range(m):
            j = at + step
            if j >= m:
                j -= m
            if known_key[j] == key[g]:
                if known_size[j] == size[g]:
                    for k in range(size[g]):
                        old = known[known_first[j] + k]
                        x[first[g] + k] = old * known_scale[known_first[j] + k] / scale[first[g] + k]
                at = j + 1 if j + 1 < m else 0
                break
    return x


@njit(cache=True, error_model="numpy")
def contact_work(kind, first, size, scale, before, after, x):
    """Return ``Lambda^T (gamma- + gamma+) / 2`` of all contacts, J, and the sum of the sizes of its terms."""
    work, total = 0.0, 0.0
    for g in range(len(kind)):
        if kind[g] == CONE:
            for k in range(first[g], first[g] + size[g]):
                part = 0.5 * x[k] * scale[k] * (before[k] + after[k])
                work += part
                total += abs(0.5 * x[k] * scale[k]) * (abs(before[k]) + abs(after[k]))
    return work, total


@njit(cache=True, error_model="numpy")
def row_velocities(rownnz, rowadr, colind, value, scale, free, z):
    """Return the velocity of each row after impulses that change the whitened velocity by z, (n,)."""
    after = free.copy()
    for r in range(len(free)):
        s = 0.0
        for a in range(rowadr[r], rowadr[r] + rownnz[r]):
            s += value[a] * z[colind[a]]
        after[r] += s / scale[r]
    return after


@njit(cache=True, error_model="numpy")
def shortfall(kind, first, target, after):
    """Return the largest amount by which a contact velocity misses its target, m/s or rad/s."""
    worst = 0.0
    for g in range(len(kind)):
        if kind[g] == CONE:
            worst = max(worst, target[g] - after[first[g]])
    return worst


@njit(cache=True, error_model="numpy")
def solve_contacts(
    rownnz, rowadr, colind, value, first, size, kind, bound, scale, before, free, rest, compliance,
    target, sliding, collides, guess, tree, exact, dissipative, rounds,
):  # fmt: skip
    """Solve the problem of a step, with all restitution scaled so that contact creates no energy.

    ``0 <= Lambda  ⊥  J v+ - s gamma^h >= 0`` where contacts collide, with friction in its cones: s is 1 unless that would
    make ``Lambda^T (gamma- + gamma+) / 2`` positive (T. R. Kane, *A dynamics puzzle*, 1984); then it is the largest one
    found that does not.

    Returns:
        Impulses (n,), in units of the problem; whitened jump of velocities (nv,); natural map relative to the velocity
        of the problem; iterations; velocities of rows afterwards (n,); the targets with s (g,).
    """
    low, high, s = 0.0, 1.0, 1.0
    scaled, aimed = target.copy(), sliding.copy()
    steps = 0
    for search in range(_SEARCHES + 1):
        for g in range(len(kind)):
            if collides[g]:
                scaled[g] = s * target[g] if target[g] > 0.0 else target[g]
                for k in range(first[g] + 1, first[g] + size[g]):
                    aimed[k] = s * sliding[k]
        b = offsets(kind, first, size, scale, free, rest, scaled, aimed)
        x, z, residual, iterations = solve(
            rownnz, rowadr, colind, value, len(tree), tree, first, size, kind, bound, compliance, b, guess, exact,
            TOLERANCE, rounds,
        )  # fmt: skip
        steps += iterations
        after = row_velocities(rownnz, rowadr, colind, value, scale, free, z)
        if not dissipative or (s == 1.0 and not collides.any()):
            break
        work, total = contact_work(kind, first, size, scale, before, after, x)
        if work <= _CREATED * total:
            if s == 1.0 or search >= _SEARCHES - 1:
                break
            low = s
        else:
            high = s
        guess = x
        s = low if search == _SEARCHES - 1 else 0.5 * (low + high)
    return x, z, residual, steps, after, scaled


@njit(cache=True, error_model="numpy")
def overlap_targets(kind, first, gap, before, after, timestep):
    """Return how fast positions beside the velocities are to open overlaps, m/s, (g,), and whether any has to.

    What the velocities open counts. Overlaps that came about in the step before are opened at once, those of the start
    at a limited speed.
    """
    need = np.zeros(len(kind))
    some = False
    for g in range(len(kind)):
        if kind[g] == CONE:
            speed = _OPENING + abs(before[first[g]])
            aim = min(0.0, gap[g] + timestep * speed)
            need[g] = (aim - gap[g]) / timestep - after[first[g]]
            some = some or (gap[g] < 0.0 and need[g] > _SLOP / timestep)
    return need, some


@njit(cache=True, error_model="numpy")
def open_overlaps(rownnz, rowadr, colind, value, first, kind, need, compliance, tree, rounds):
    """Return the least whitened velocity, (nv,), that moves positions as is needed: ``J w >= need``, no friction."""
    groups = len(kind)
    keep = np.zeros(groups, np.bool_)
    for g in range(groups):
        keep[g] = kind[g] == CONE or kind[g] == BILATERAL
    m = int(keep.sum())
    nnz, adr = np.empty(m, np.int32), np.empty(m, np.int32)
    start, one, kinds = np.empty(m, np.int32), np.ones(m, np.int32), np.empty(m, np.int32)
    b, soft = np.zeros(m), np.zeros(m)
    i = 0
    for g in range(groups):
        if keep[g]:
            nnz[i], adr[i], start[i], kinds[i] = rownnz[first[g]], rowadr[first[g]], i, kind[g]
            if kind[g] == CONE:
                b[i] = -need[g]
            else:
                soft[i] = compliance[first[g]]
            i += 1
    _, z, _, _ = solve(
        nnz, adr, colind, value, len(tree), tree, start, one, kinds, np.zeros(m), soft, b, np.zeros(m), True, TOLERANCE,
        rounds,
    )  # fmt: skip
    return z


@njit(cache=True, error_model="numpy")
def velocity_change(z, factor, Mnnz, Madr, Mcol, inverse):
    """Return the change of velocity, (nv,), of a whitened one."""
    return unwhiten(z, factor, Mnnz, Madr, Mcol, np.sqrt(inverse))
