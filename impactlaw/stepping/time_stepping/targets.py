"""What contact velocities a step aims at: the law's where contacts collide, elsewhere just not through the surface."""

from __future__ import annotations

import numpy as np
from numba import njit

from impactlaw.stepping.time_stepping.rows import CONE

CLOSED = 1e-5
"""Gap, m or rad, up to which a contact counts as closed where a law asks for all closed contacts."""


@njit(cache=True, error_model="numpy")
def contact_targets(kind, first, gap, before, free, timestep, restitution, slowest, resolved):
    """Return the targets of Moreau's and Jean's scheme, and which contacts collide.

    A contact collides if it approaches, ``gamma- < -threshold``, and is closed, or would be before the next look at
    contacts, ``gap + h gamma_free < 0``. Then ``gamma^h = -e gamma-``. Any other may come as close as to touch,
    ``gamma^h = -gap / h`` while it is open and 0 when it is not. The threshold is what forces make of a contact at rest
    within a step, ``h |J a|``, at least ``slowest`` and at most ``resolved``: slower collisions are not resolved.

    Args:
        kind: of each group, (g,).
        first: first row of each group, (g,).
        gap: of contacts and limits, m or rad, (g,).
        before: ``gamma-``, velocity of each row at the start, (n,).
        free: that to which the forces without contact lead, (n,).
        timestep: h, s.
        restitution: e.
        slowest: least threshold, m/s or rad/s.
        resolved: largest threshold.

    Returns:
        ``gamma^h``, (g,), and whether each group collides, bool (g,).
    """
    target, collides = np.zeros(len(kind)), np.zeros(len(kind), np.bool_)
    for g in range(len(kind)):
        if kind[g] != CONE:
            continue
        gamma, led = before[first[g]], free[first[g]]
        threshold = min(max(slowest, gamma - led), resolved)
        if gamma < -threshold and (gap[g] <= 0.0 or gap[g] + timestep * led < 0.0):
            collides[g] = True
            target[g] = -restitution * gamma
        elif gap[g] > 0.0:
            target[g] = -gap[g] / timestep
    return target, collides


@njit(cache=True, error_model="numpy")
def offsets(kind, first, size, scale, free, rest, target, sliding):
    """Return b of the problem ``u = Y Y^T x + c x + b``, (n,): velocities without contact, less those aimed at.

    Args:
        kind: of each group, (g,).
        first: first row of each group, (g,).
        size: rows of each group, (g,).
        scale: coefficient of friction of rows of friction, else 1, (n,).
        free: velocity of each row without contact, (n,).
        rest: velocity at which an equality is met, (n,).
        target: ``gamma^h``, (g,).
        sliding: sliding velocities aimed at, (n,).
    """
    b = np.empty(len(free))
    for g in range(len(kind)):
        f = first[g]
        if kind[g] == CONE:
            b[f] = free[f] - target[g]
            for k in range(f + 1, f + size[g]):
                b[k] = scale[k] * (free[k] - sliding[k])
        else:
            b[f] = free[f] - rest[f]
    return b
