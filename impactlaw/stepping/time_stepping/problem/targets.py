"""The contact velocities that a step aims at: the law's for colliding contacts, else no penetration at its end."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import cleared, kernel, plain
from impactlaw.solvers.cones.rows import trees_of
from impactlaw.stepping.time_stepping.problem.gradient_turns import SMOOTH
from impactlaw.stepping.time_stepping.problem.rows import NEAR, is_length
from impactlaw.stepping.time_stepping.tolerances import RESOLVED

_RESTING = 1e-6
"""Part of the largest contact velocity up to which a closed contact does not separate."""
_ROUNDED = 1.0 + 1e-9
"""Factor on the velocity that forces account for, up to which a contact does not collide.

A body that has stopped slightly above the floor falls on at exactly this speed, and rounding must not decide which of
its corners collide.
"""

_STILL = 1e-9
"""Closing speed, m/s or rad/s, up to which a persistent contact does not turn: it is rounding.

Rounded targets contradict each other where contacts are redundant, and shift impulses among these.
"""

_OPEN = 0.1
"""Gap above which a persistent contact is open, relative to the way in a timestep at the speed of the gradient's turn.

A body that flies from one side to the other within a step has a larger gap.
"""

_JUST = 1.0 - 1e-9
"""Largest gap of a contact that closes within a timestep, relative to its way in that time, except for rounding."""


@plain
def aim(rows, timestep, restitution, slowest, resolved, may, target, collides):
    """Write the targets of the scheme of Moreau and Jean, and which contacts collide; return whether any does.

    A contact collides if it approaches, ``gamma- < -threshold``, and is closed, or would be before the next
    detection, ``gap + h gamma_free < 0``. Its target is ``gamma^h = -e gamma-``. Any other contact may close but not
    penetrate: ``gamma^h = -gap / h`` if it is open, and 0 if it is closed.

    A persistent contact may approach only because its gradient turns by ``d < 0``, much as in the last step
    (`gradient_turns`). If it approaches more slowly than ``resolved``, it does not collide, and ``-d / 2`` is added to
    its target, limited to the range from ``-e gamma-`` to ``-gamma-`` so that no energy is created.

    The threshold is the velocity that forces give a contact at rest within a step, ``h |J a|``, but at most
    ``resolved``, and at least ``slowest``: slower collisions are not resolved.

    Args:
        rows: see `rows.Rows`.
        timestep: h, s.
        restitution: e.
        slowest: least threshold, m/s, and that of limits of joints, m/s or rad/s.
        resolved: largest velocity that is attributed to forces; for limits of joints `RESOLVED` at most.
        may: which groups may collide, bool (g,).
        target: ``gamma^h``, (g,), written.
        collides: whether each group collides, bool (g,), written.
    """
    some, groups, rates = False, rows.groups, rows.rates
    for g in range(len(target)):
        target[g], collides[g] = 0.0, False
        if groups[2, g] != CONE:
            continue
        gap, gamma, led = rows.amounts[0, g], rates[1, groups[0, g]], rates[2, groups[0, g]]
        turn = gamma - rates[5, groups[0, g]]
        least, most = (slowest[0], resolved) if is_length(rows, g) else (slowest[1], min(resolved, RESOLVED))
        smooth = abs(turn - rates[6, groups[0, g]]) <= -SMOOTH * turn  # and turn < 0; not where some are NaN
        if smooth and -most < gamma < -_STILL and gap <= -_OPEN * timestep * turn:
            target[g] = max(min(-0.5 * turn, -gamma), -restitution * gamma) - max(gap, 0.0) / timestep
            continue
        threshold = max(least, min(_ROUNDED * (gamma - led), most))
        if may[g] and gamma < -threshold and (gap <= 0.0 or gap + timestep * led < 0.0):
            collides[g] = some = True
            target[g] = -restitution * gamma
        elif gap > 0.0:
            target[g] = -gap / timestep
    return some


@plain
def write_closing(rows, timestep, collided):
    """Reduce gaps so that contacts that have collided still close within the step at the velocity without contact.

    Forces that change with the collision can lead to a velocity that closes a contact slightly too late. Without the
    collision they would lead to a velocity that closes it in time, so that neither answer would be consistent.

    Args:
        rows: see `rows.Rows`; gaps are written.
        timestep: h, s.
        collided: which groups have collided, bool (g,).
    """
    for g in range(len(collided)):
        led = rows.rates[2, rows.groups[0, g]]
        if collided[g] and led < 0.0:
            rows.amounts[0, g] = min(rows.amounts[0, g], -_JUST * timestep * led)


@plain
def write_offsets(groups, rates, target, sliding, b):
    """Write b of the problem ``u = Y Y^T x + c x + b``, (n,): velocities without contact minus target velocities.

    Args:
        groups: see `rows.Rows`.
        rates: see `rows.Rows`.
        target: ``gamma^h``, (g,).
        sliding: target sliding velocities, (n,).
        b: written.
    """
    for g in range(groups.shape[1]):
        f = groups[0, g]
        if groups[2, g] == CONE:
            b[f] = rates[2, f] - target[g]
            for k in range(f + 1, f + groups[1, g]):
                b[k] = rates[0, k] * (rates[2, k] - sliding[k])
        else:
            b[f] = rates[2, f] - rates[3, f]


@plain
def joins(rows, tree, g, mark, near):
    """Return whether a group is near, or shares a marked tree; if so, mark its trees, too."""
    begin = rows.sparse[1, rows.groups[0, g]]
    end = begin + rows.sparse[0, rows.groups[0, g]]
    for a in range(begin, end):
        near = near or mark[tree[rows.colind[a]]]
    for a in range(begin, end if near else begin):
        mark[tree[rows.colind[a]]] = True
    return near


@plain
def reach(rows, tree, collides, pushed, mark, reached):
    """Write the result of `reached_groups` to an array of False, (g,); ``mark`` is False for each tree."""
    groups, rates, fastest = rows.groups, rows.rates, 0.0
    for g in range(len(collides)):
        fastest = max(fastest, abs(rates[1, groups[0, g]]))
    more = True
    while more:
        more = False
        for g in range(len(reached)):
            row = groups[0, g]
            touches = groups[2, g] == CONE and rows.amounts[0, g] <= NEAR
            touches = touches and (pushed[g] or rates[1, row] <= _RESTING * fastest)
            if not reached[g] and (collides[g] or touches) and joins(rows, tree, g, mark, collides[g]):
                reached[g] = more = True


@kernel
def reached_groups(rows, tree, collides, pushed):
    """Return which contacts collide, or are reached by collisions through others and do not separate, bool (g,).

    A contact is reached if it touches a kinematic tree that an impulse can reach. It does not separate if its velocity
    shows that, or if it is pushed.

    Args:
        rows: see `rows.Rows`.
        tree: tree of each degree of freedom, (nv,).
        collides: which groups collide, bool (g,).
        pushed: which groups are pushed, bool (g,).
    """
    reached = np.zeros(len(collides), np.bool_)
    reach(rows, tree, collides, pushed, cleared(trees_of(tree)), reached)
    return reached


@plain
def _is_nearly_closed(rows, collides, target):
    """Return whether some closed contact still has a gap, and does not collide."""
    for g in range(len(target)):
        if rows.groups[2, g] == CONE and not collides[g] and target[g] < 0.0 and rows.amounts[0, g] <= NEAR:
            return True
    return False


@kernel
def close_gaps(rows, tree, collides, target):
    """Keep closed contacts that a collision reaches closed, ``gamma^h = 0``, however small their gap is.

    ``target``, (g,), is written. For the other arguments see `reached_groups`.
    """
    if not _is_nearly_closed(rows, collides, target):
        return
    pushed, reached = cleared(len(target)), cleared(len(target))
    pushed[:] = True
    reach(rows, tree, collides, pushed, cleared(trees_of(tree)), reached)
    for g in range(len(target)):
        if reached[g] and not collides[g]:
            target[g] = max(target[g], 0.0)
