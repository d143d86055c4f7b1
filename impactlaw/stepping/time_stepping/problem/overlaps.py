"""Overlaps of bodies, and the separate velocity of positions that opens them."""

from __future__ import annotations

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones import BILATERAL, CONE
from impactlaw.solvers.cones.algebra.loops import FLOATS, clear, numbers, plain
from impactlaw.stepping.compiled.whitening import INERTIA, unwhitened
from impactlaw.stepping.time_stepping.problem.rows import ROWS

COUNTED = 1e-5
"""Depth, m, up to which an overlap that a step leaves is not counted."""
_SLOP = 1e-8  # m or rad: smaller overlaps are left to the velocities
_SWEEPS = 40  # number of sweeps over contacts that overlap
_SETTLED = 1e-4  # change of velocity, relative to the needed velocity, up to which the iteration has converged
_OPENING = 0.2  # m/s or rad/s: least speed at which overlaps of the start are opened
_OPENING_TIME = 0.1  # s: time in which most of a deep overlap is opened
_FARTHEST = 0.1  # m or rad: largest motion that opens overlaps in one step, unless some are deeper
_ALONG = 30.0  # sliding distance per opening distance from which a motion does not count as opening an overlap
_NEVER = -1e30  # m/s: the needed velocity of a contact that need not open


@plain
def overlap_targets(rows, after, timestep, need):
    """Write how fast positions must open overlaps beyond the velocities, m/s, (g,); return whether any must.

    The motion by the velocities is counted until the middle of the next step; if it opens a contact between bodies,
    only until the end of this step. Overlaps that arose in the last step are opened at once, those of the start at a
    limited speed.
    """
    groups, rates, some = rows.groups, rows.rates, False
    for g in range(len(need)):
        need[g] = 0.0
        if groups[2, g] == CONE:
            row, gap = groups[0, g], rows.amounts[0, g]
            aim = min(0.0, gap + timestep * (_OPENING + abs(rates[1, row]) - min(gap, 0.0) / _OPENING_TIME))
            opened = after[row] * (0.5 if after[row] > 0.0 and groups[3, g] >= 0 else 1.0)
            need[g] = (aim - gap) / timestep - opened
            some = some or (gap < 0.0 and need[g] > _SLOP / timestep)
    return some


@plain
def _leave_out(rows, need, z):
    """Leave overlaps alone that no motion opens well, since it would move the surfaces along each other by far more.

    An example is a finger that slides across its palm, with hulls that share some volume: opening would move it
    anywhere. ``z`` is scratch space, (nv,).
    """
    sparse, colind, value, groups = rows.sparse, rows.colind, rows.value, rows.groups
    for g in range(len(need)):
        if groups[2, g] != CONE or groups[1, g] < 2 or need[g] <= 0.0:
            continue
        normal, G, along = groups[0, g], 0.0, 0.0
        clear(z)
        for a in range(sparse[1, normal], sparse[1, normal] + sparse[0, normal]):
            z[colind[a]] = value[a]
            G += value[a] * value[a]
        for row in range(normal + 1, normal + groups[1, g]):
            if sparse[2, row] - sparse[2, normal] > 2:  # torsion and rolling
                break
            velocity = 0.0
            for a in range(sparse[1, row], sparse[1, row] + sparse[0, row]):
                velocity += value[a] * z[colind[a]]
            along += (velocity / rows.rates[0, row]) ** 2  # rows of friction are scaled by its coefficient
        if along > _ALONG * _ALONG * G * G:
            need[g] = _NEVER


@plain
def _velocity(rows, g, z):
    """Return the normal velocity of a group due to a whitened velocity."""
    nnz, adr, row, velocity = rows.sparse[0], rows.sparse[1], rows.groups[0, g], 0.0
    for a in range(adr[row], adr[row] + nnz[row]):
        velocity += rows.value[a] * z[rows.colind[a]]
    return velocity


@plain
def _mark(rows, g, mark):
    """Mark the degrees of freedom of a group; return whether one of them was not marked before."""
    nnz, adr, row, new = rows.sparse[0], rows.sparse[1], rows.groups[0, g], False
    for a in range(adr[row], adr[row] + nnz[row]):
        if mark[rows.colind[a]] == 0.0:
            mark[rows.colind[a]], new = 1.0, True
    return new


@plain
def _is_marked(rows, g, mark):
    """Return whether a degree of freedom of a group is marked."""
    nnz, adr, row, some = rows.sparse[0], rows.sparse[1], rows.groups[0, g], False
    for a in range(adr[row], adr[row] + nnz[row]):
        some = some or mark[rows.colind[a]] != 0.0
    return some


@plain
def _hold_squeezed(rows, need, largest, x, z, mark):
    """Scale down the velocity of bodies that are squeezed, such that no overlap gets deeper than the deepest one.

    There is no solution for them: what opens some of their overlaps makes others deeper. ``mark`` is scratch space,
    (nv,).
    """
    share, more = 1.0, False
    clear(mark)
    for g in range(len(need)):
        if rows.groups[2, g] == CONE and rows.groups[3, g] >= 0:
            velocity = _velocity(rows, g, z)
            if need[g] - velocity > (1.0 + _SETTLED) * largest:
                share, more = min(share, (largest - need[g]) / -velocity), True
                _mark(rows, g, mark)
    while more:
        more = False
        for g in range(len(need)):
            if _is_marked(rows, g, mark):
                more = _mark(rows, g, mark) or more
    for i in range(len(z)):
        z[i] *= share if mark[i] != 0.0 else 1.0
    for g in range(len(need)):
        x[g] = 0.0 if rows.groups[2, g] == CONE else x[g]


@plain
def _move_apart(rows, need, x, z, mark):
    """Write a small whitened velocity, (nv,), with ``J w >= need``; x, (g,), and mark, (nv,), are scratch space.

    It is found by projected Gauss-Seidel; the next step corrects its error. If not everything can be opened, limits
    take precedence.
    """
    sparse, colind, value, groups = rows.sparse, rows.colind, rows.value, rows.groups
    _leave_out(rows, need, z)
    clear(z)
    clear(x)
    largest = 0.0
    for g in range(len(need)):
        if groups[2, g] == CONE:
            largest = max(largest, need[g])
    for sweep in range(2 * _SWEEPS):
        change = 0.0
        for g in range(len(need)):
            if groups[2, g] != CONE and groups[2, g] != BILATERAL:
                continue
            if sweep >= _SWEEPS and groups[2, g] == CONE and groups[3, g] >= 0:
                continue
            row = groups[0, g]
            begin, end = sparse[1, row], sparse[1, row] + sparse[0, row]
            soft = rows.rates[4, row] if groups[2, g] == BILATERAL else 0.0
            velocity, G = soft * x[g] + _velocity(rows, g, z), soft
            for a in range(begin, end):
                G += value[a] * value[a]
            if G == 0.0:
                continue
            new = x[g] - velocity / G if groups[2, g] == BILATERAL else max(0.0, x[g] + (need[g] - velocity) / G)
            step = new - x[g]
            x[g] = new
            change = max(change, abs(step) * G)
            for a in range(begin, end):
                z[colind[a]] += step * value[a]
        if change <= _SETTLED * largest:
            break
        if sweep == _SWEEPS - 1:
            _hold_squeezed(rows, need, largest, x, z, mark)


@linked(types.void(ROWS, FLOATS, types.float64, INERTIA, FLOATS))
def open_overlaps(rows, need, timestep, inertia, shift):
    """Write a velocity, (nv,), that moves positions as needed, ``J w >= need``, without friction.

    No joint moves by more than `_FARTHEST` in a step, or the largest opening if that is more: a gradient that nearly
    vanishes would ask for any motion.
    """
    root, z = numbers(len(shift)), numbers(len(shift))
    for i in range(len(root)):
        root[i] = np.sqrt(inertia.inverse[i])
    _move_apart(rows, need, numbers(len(need)), z, shift)
    unwhitened(z, inertia, root, shift)
    most, farthest = 0.0, _FARTHEST
    for speed in shift:
        most = max(most, timestep * abs(speed))
    for speed in need:
        farthest = max(farthest, timestep * speed)
    if most > farthest:
        for i in range(len(shift)):
            shift[i] *= farthest / most
