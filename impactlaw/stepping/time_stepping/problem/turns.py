"""What the gradients of closed contacts turn from step to step: contact that goes on, and does not collide.

A contact whose impulse acts in a step ends it with the velocity that it aims at, ``t = J v+``. In the middle of the
next step its gradient has turned, and ``gamma- = J' v+ = t + d`` with the turn d, about ``h v^T J_q v``: the bob of a
taut rope of length L closes it by ``h v^2 / L`` in every step. Where a surface moves, what its velocity changes is
in d, too.
"""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.time_stepping.problem.rows import find_group

SMOOTH = 0.25
"""Part of what a gradient turns in a step by which that changes at most from step to step where contact goes on."""
_STICKS = 1.0 - 1e-9
"""Part of the friction that a contact can have up to which it sticks."""


@plain
def write_recalled(groups, key, rates, known_groups, known_key, known_turns):
    """Do what `recall_turns` does."""
    at = 0
    for g in range(len(key)):
        j = find_group(key[g], known_key, at)
        if j >= 0 and known_groups[1, j] == groups[1, g]:
            for k in range(groups[1, g]):
                for i in range(2):
                    rates[5 + i, groups[0, g] + k] = known_turns[i, known_groups[0, j] + k]
        at = (j + 1) % len(known_key) if j >= 0 else at


@compiled()
def recall_turns(groups, key, rates, known_groups, known_key, known_turns):
    """Write what `take_turns` has written in the step before, where the same group has as many rows, to `rates`.

    Groups of one key are matched in their order, see `rows.find_group`.

    Args:
        groups: see `rows.Rows`, like the two that follow.
        key: of groups.
        rates: the last two of them are written; they are NaN before.
        known_groups: groups of the step before.
        known_key: keys of the step before.
        known_turns: what `take_turns` has written then, (2, n).
    """
    write_recalled(groups, key, rates, known_groups, known_key, known_turns)


@plain
def write_turns(groups, rates, x, reached, sliding):
    """Do what `take_turns` does."""
    for g in range(len(reached)):
        row, end, friction = groups[0, g], groups[0, g] + groups[1, g], 0.0
        acts = groups[2, g] == CONE and x[row] > 0.0 and not np.isnan(reached[g])
        for k in range(row + 1, end):
            friction += x[k] * x[k]
        sticks = acts and friction < (_STICKS * x[row]) ** 2
        for k in range(row, end):
            known = acts if k == row else sticks
            rates[6, k] = rates[1, k] - rates[5, k]
            rates[5, k] = (reached[g] if k == row else sliding[k]) if known else np.nan


@compiled()
def take_turns(groups, rates, x, reached, sliding):
    """Write the velocities t that rows end a step with where an impulse keeps them there, and the turns d before it.

    Args:
        groups: see `rows.Rows`, like what follows.
        rates: the last two of them are written: t and d, NaN where there is none.
        x: impulses, (n,).
        reached: targets of normal velocities, (g,); NaN where the step ends with other ones.
        sliding: those of sliding velocities, (n,).
    """
    write_turns(groups, rates, x, reached, sliding)


@plain
def write_sliding(groups, rates, resolved, sliding):
    """Do what `keep_sticking` does."""
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


@compiled()
def keep_sticking(groups, rates, resolved, sliding):
    """Let contacts that stick end a step without a collision with minus half of what their gradients turn, ``-d / 2``.

    Args:
        groups: see `rows.Rows`.
        rates: see `rows.Rows`.
        resolved: what gradients turn counts up to this, m/s.
        sliding: sliding velocities aimed at, (n,), written.
    """
    write_sliding(groups, rates, resolved, sliding)
