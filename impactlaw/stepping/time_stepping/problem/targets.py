"""What contact velocities a step aims at: the law's where contacts collide, elsewhere just not through the surface."""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import cleared, plain
from impactlaw.solvers.cones.rows import trees_of
from impactlaw.stepping.time_stepping.problem.rows import NEAR
from impactlaw.stepping.time_stepping.problem.turns import SMOOTH

_RESTING = 1e-6
"""Part of the largest contact velocity up to which a contact in touch does not separate."""
_ROUNDED = 1.0 + 1e-9
"""Part of what forces make up to which a contact does not collide.

A body that has stopped a little above the floor falls on at just this speed, and rounding must not decide which of its
corners collide."""

_OPEN = 0.1
"""Part of the way of a timestep, at the speed that is the turn of the gradient, up to which contact that goes on is
open: what flies from one side to the other in a step is farther away."""

_JUST = 1.0 - 1e-9
"""Part of the way of a timestep that a contact has at most that closes within it, but for rounding."""


@plain
def aim(groups, amounts, rates, timestep, restitution, slowest, resolved, may, target, collides):
    """Write what `contact_targets` returns, (g,) each, and return whether some contact collides."""
    some = False
    for g in range(len(target)):
        target[g], collides[g] = 0.0, False
        if groups[2, g] != CONE:
            continue
        gap, gamma, led = amounts[0, g], rates[1, groups[0, g]], rates[2, groups[0, g]]
        turn = gamma - rates[5, groups[0, g]]
        smooth = abs(turn - rates[6, groups[0, g]]) <= -SMOOTH * turn  # and turn < 0; not where some are NaN
        if smooth and -resolved < gamma < 0.0 and gap <= -_OPEN * timestep * turn:
            target[g] = max(min(-0.5 * turn, -gamma), -restitution * gamma) - max(gap, 0.0) / timestep
            continue
        threshold = max(slowest, min(_ROUNDED * (gamma - led), resolved))
        if may[g] and gamma < -threshold and (gap <= 0.0 or gap + timestep * led < 0.0):
            collides[g] = some = True
            target[g] = -restitution * gamma
        elif gap > 0.0:
            target[g] = -gap / timestep
    return some


@plain
def write_closing(groups, amounts, rates, timestep, collided):
    """Do what `keep_closing` does."""
    for g in range(len(collided)):
        led = rates[2, groups[0, g]]
        if collided[g] and led < 0.0:
            amounts[0, g] = min(amounts[0, g], -_JUST * timestep * led)


@compiled()
def keep_closing(groups, amounts, rates, timestep, collided):
    """Let contacts that have collided still close within the step, with the velocity without contact of now.

    Forces that change with the collision can lead to a velocity that closes them a little later. Without the collision
    they would lead to one that closes them in time, so that neither would be right.

    Args:
        groups: see `rows.Rows`, like the two that follow; gaps in `amounts` are written.
        amounts: gaps first.
        rates: velocities without contact third.
        timestep: h, s.
        collided: bool (g,).
    """
    write_closing(groups, amounts, rates, timestep, collided)


@compiled()
def contact_targets(groups, amounts, rates, timestep, restitution, slowest, resolved, may):
    """Return the targets of Moreau's and Jean's scheme, and which contacts collide.

    A contact collides if it approaches, ``gamma- < -threshold``, and is closed, or would be before the next look at
    contacts, ``gap + h gamma_free < 0``. Then ``gamma^h = -e gamma-``. Any other may come as close as to touch,
    ``gamma^h = -gap / h`` while it is open and 0 when it is not. One that goes on, and approaches more slowly than
    ``resolved`` because its gradient turns by ``d < 0`` much as in the step before (`turns`), has ``-d / 2`` added to
    that, between ``-e gamma-`` and ``-gamma-`` so that no energy comes of it, and does not collide. The threshold is
    what forces make of a contact at rest within a step, ``h |J a|``, but at most ``resolved``, and at least
    ``slowest``: slower collisions are not resolved.

    Args:
        groups: see `rows.Rows`, like the two that follow.
        amounts: gaps first.
        rates: velocities of rows at the start of the step, and without contact; their turns.
        timestep: h, s.
        restitution: e.
        slowest: least threshold, m/s or rad/s.
        resolved: what forces make counts up to this.
        may: which groups may collide, bool (g,).

    Returns:
        ``gamma^h``, (g,), and whether each group collides, bool (g,).
    """
    target, collides = np.empty(groups.shape[1]), np.empty(groups.shape[1], np.bool_)
    aim(groups, amounts, rates, timestep, restitution, slowest, resolved, may, target, collides)
    return target, collides


@plain
def write_offsets(groups, rates, target, sliding, b):
    """Write b of the problem ``u = Y Y^T x + c x + b``, (n,): velocities without contact, less those aimed at.

    Args:
        groups: see `rows.Rows`.
        rates: see `rows.Rows`.
        target: ``gamma^h``, (g,).
        sliding: sliding velocities aimed at, (n,).
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
def reach(groups, sparse, colind, amounts, rates, tree, collides, pushed, mark, reached):
    """Write what `reached_groups` returns to False, (g,); there are marks of trees, False."""
    fastest = 0.0
    for g in range(len(collides)):
        fastest = max(fastest, abs(rates[1, groups[0, g]]))
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
    reached = np.zeros(len(collides), np.bool_)
    reach(groups, sparse, colind, amounts, rates, tree, collides, pushed, cleared(trees_of(tree)), reached)
    return reached


@plain
def _is_nearly_closed(groups, amounts, collides, target):
    """Return whether some contact in touch has a gap, and does not collide."""
    for g in range(len(target)):
        if groups[2, g] == CONE and not collides[g] and target[g] < 0.0 and amounts[0, g] <= NEAR:
            return True
    return False


@plain
def _close(reached, collides, target):
    for g in range(len(target)):
        if reached[g] and not collides[g]:
            target[g] = max(target[g], 0.0)


@compiled()
def close_gaps(groups, sparse, colind, amounts, rates, tree, collides, target):
    """Let contacts in touch that a collision reaches stay closed, ``gamma^h = 0``, however small their gap is.

    ``target``, (g,), is written; for the others see `reached_groups`.
    """
    if not _is_nearly_closed(groups, amounts, collides, target):
        return
    pushed, reached = cleared(len(target)), cleared(len(target))
    pushed[:] = True
    reach(groups, sparse, colind, amounts, rates, tree, collides, pushed, cleared(trees_of(tree)), reached)
    _close(reached, collides, target)
