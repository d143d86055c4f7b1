"""What contact velocities a step aims at: the law's where contacts collide, elsewhere just not through the surface."""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.solvers.cones import CONE
from impactlaw.stepping.time_stepping.problem.rows import NEAR

_RESTING = 1e-12
"""Part of the largest contact velocity up to which a contact in touch does not separate."""


@compiled()
def contact_targets(groups, amounts, rates, timestep, restitution, slowest, resolved, may):
    """Return the targets of Moreau's and Jean's scheme, and which contacts collide.

    A contact collides if it approaches, ``gamma- < -threshold``, and is closed, or would be before the next look at
    contacts, ``gap + h gamma_free < 0``. Then ``gamma^h = -e gamma-``. Any other may come as close as to touch,
    ``gamma^h = -gap / h`` while it is open and 0 when it is not. The threshold is what forces make of a contact at rest
    within a step, ``h |J a|``, but at most ``resolved``, and at least ``slowest``: slower collisions are not resolved.

    Args:
        groups: see `rows.Rows`, like the two that follow.
        amounts: gaps first.
        rates: velocities of rows at the start of the step, and without contact.
        timestep: h, s.
        restitution: e.
        slowest: least threshold, m/s or rad/s.
        resolved: what forces make counts up to this.
        may: which groups may collide, bool (g,).

    Returns:
        ``gamma^h``, (g,), and whether each group collides, bool (g,).
    """
    first, kind, gap, before, free = groups[0], groups[2], amounts[0], rates[1], rates[2]
    target, collides = np.zeros(len(kind)), np.zeros(len(kind), np.bool_)
    for g in range(len(kind)):
        if kind[g] != CONE:
            continue
        gamma, led = before[first[g]], free[first[g]]
        threshold = max(slowest, min(gamma - led, resolved))
        if may[g] and gamma < -threshold and (gap[g] <= 0.0 or gap[g] + timestep * led < 0.0):
            collides[g] = True
            target[g] = -restitution * gamma
        elif gap[g] > 0.0:
            target[g] = -gap[g] / timestep
    return target, collides


@compiled()
def offsets(groups, rates, target, sliding):
    """Return b of the problem ``u = Y Y^T x + c x + b``, (n,): velocities without contact, less those aimed at.

    Args:
        groups: see `rows.Rows`.
        rates: see `rows.Rows`.
        target: ``gamma^h``, (g,).
        sliding: sliding velocities aimed at, (n,).
    """
    first, size, kind = groups[0], groups[1], groups[2]
    scale, free, rest = rates[0], rates[2], rates[3]
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


@compiled()
def reached_groups(groups, sparse, colind, amounts, rates, tree, collides, pushed):
    """Return which contacts collide, or are reached by these through others and do not separate, bool (g,).

    A contact is reached if it touches a kinematic tree that an impulse can reach. It does not separate if its velocity
    says so, or if it is pushed.

    Args:
        groups: see `rows.Rows`, like the four that follow.
        sparse: where rows begin and how long they are.
        colind: degrees of freedom of their entries.
        amounts: gaps first.
        rates: velocities at the start of the step second.
        tree: of each degree of freedom, (nv,).
        collides: bool (g,).
        pushed: bool (g,).
    """
    fastest = 0.0
    for g in range(len(collides)):
        fastest = max(fastest, abs(rates[1, groups[0, g]]))
    mark = np.zeros(tree.max() + 1 if len(tree) else 0, np.bool_)
    reached = np.zeros(len(collides), np.bool_)
    more = True
    while more:
        more = False
        for g in range(len(reached)):
            row = groups[0, g]
            touches = groups[2, g] == CONE and amounts[0, g] <= NEAR
            touches = touches and (pushed[g] or rates[1, row] <= _RESTING * fastest)
            if reached[g] or not (collides[g] or touches):
                continue
            begin, end = sparse[1, row], sparse[1, row] + sparse[0, row]
            near = collides[g]
            for a in range(begin, end):
                near = near or mark[tree[colind[a]]]
            if near:
                reached[g] = more = True
                for a in range(begin, end):
                    mark[tree[colind[a]]] = True
    return reached


@compiled()
def close_gaps(groups, sparse, colind, amounts, rates, tree, collides, target):
    """Let contacts in touch that a collision reaches stay closed, ``gamma^h = 0``, however small their gap is.

    ``target``, (g,), is written; for the others see `reached_groups`.
    """
    some = False
    for g in range(len(target)):
        some = some or (groups[2, g] == CONE and not collides[g] and target[g] < 0.0 and amounts[0, g] <= NEAR)
    if not some:
        return
    pushed = np.ones(len(collides), np.bool_)
    reached = reached_groups(groups, sparse, colind, amounts, rates, tree, collides, pushed)
    for g in range(len(target)):
        if reached[g] and not collides[g]:
            target[g] = max(target[g], 0.0)
