"""Turns of the gradients of closed contacts from step to step: a persistent contact that does not collide.

A contact whose impulse acts in a step ends it at its target velocity, ``t = J v+``. In the middle of the next step its
gradient has turned, and ``gamma- = J' v+ = t + d`` with the turn d, about ``h v^T J_q v``. For example, the bob of a
taut rope of length L closes the contact by ``h v^2 / L`` in every step. The change of a moving surface's velocity is
included in d.
"""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.time_stepping.problem.rows import find_group
from impactlaw.stepping.time_stepping.tolerances import SHORTFALL_LIMIT, SLOWEST

SMOOTH = 0.25
"""Largest change of the turn d from step to step, relative to d, at which a contact counts as persistent."""
_STICKS = 1.0 - 1e-9
"""Part of the available friction up to which a contact sticks."""


@plain
def write_recalled(rows, known):
    """Copy the results of `write_turns` in the last step to `Rows.rates`, NaN before, for groups that are the same.

    These have as many rows. Groups with equal keys are matched in order, see `rows.find_group`.
    """
    at, groups = 0, rows.groups
    for g in range(len(rows.key)):
        j = find_group(rows.key[g], known.key, at)
        if j >= 0 and known.groups[1, j] == groups[1, g]:
            for k in range(groups[1, g]):
                for i in range(2):
                    rows.rates[5 + i, groups[0, g] + k] = known.turns[i, known.groups[0, j] + k]
        at = (j + 1) % len(known.key) if j >= 0 else at


@plain
def _slips(rows, g, sliding, z):
    """Return whether a contact ends the step with other tangential velocities than those aimed at."""
    slip, size, row = 0.0, 0.0, rows.groups[0, g]
    for k in range(row + 1, row + rows.groups[1, g]):
        along, scale = 0.0, rows.rates[0, k]
        for a in range(rows.sparse[1, k], rows.sparse[1, k] + rows.sparse[0, k]):
            along += rows.value[a] * z[rows.colind[a]]
        size += rows.rates[1, k] ** 2
        slip += (rows.rates[2, k] + along / scale - sliding[k]) ** 2 if scale > 0.0 else np.inf
    return slip > SHORTFALL_LIMIT**2 * max(SLOWEST**2, size)


@plain
def write_turns(rows, x, reached, sliding, z):
    """Write the velocities t at which impulses hold rows at the end of a step, and the turns d before it.

    A contact also sticks if impulses elsewhere hold it, as an unloaded corner of a box, or if its friction is used up
    only by that of other points of the body.

    Args:
        rows: see `rows.Rows`; the last two of its rates are written: t and d, NaN where there are none.
        x: impulses, (n,).
        reached: targets of normal velocities, (g,); NaN where the step ends with another velocity.
        sliding: targets of sliding velocities, (n,).
        z: whitened change of velocity, (nv,).
    """
    groups, rates = rows.groups, rows.rates
    for g in range(len(reached)):
        row, end, friction = groups[0, g], groups[0, g] + groups[1, g], 0.0
        held = groups[2, g] == CONE and not np.isnan(reached[g])
        acts = held and x[row] > 0.0
        for k in range(row + 1, end):
            friction += x[k] * x[k]
        sticks = acts and friction < (_STICKS * x[row]) ** 2
        if held and not sticks and end > row + 1 and rows.amounts[0, g] <= 0.0:
            sticks = not _slips(rows, g, sliding, z)
        for k in range(row, end):
            known = acts if k == row else sticks
            rates[6, k] = rates[1, k] - rates[5, k]
            rates[5, k] = (reached[g] if k == row else sliding[k]) if known else np.nan


@plain
def write_sliding(groups, rates, resolved, sliding):
    """Aim sticking contacts, in a step without a collision, at minus half of the turns of their gradients, ``-d / 2``.

    Args:
        groups: see `rows.Rows`.
        rates: see `rows.Rows`.
        resolved: largest turn that counts, m/s.
        sliding: target sliding velocities, (n,), written.
    """
    for g in range(groups.shape[1]):
        if groups[2, g] != CONE:
            continue
        size, change, row = 0.0, 0.0, groups[0, g]
        for k in range(row + 1, row + groups[1, g]):
            turn = rates[1, k] - rates[5, k]
            size += turn * turn
            change += (turn - rates[6, k]) ** 2
        if change <= SMOOTH * SMOOTH * size and size < resolved * resolved:
            for k in range(row + 1, row + groups[1, g]):
                sliding[k] = 0.5 * (rates[5, k] - rates[1, k])
