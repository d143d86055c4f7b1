"""Equality constraints whose drift drives a collision: they collide themselves, as stops do, and add no energy.

An equality with the velocity u- that aims at t does the work ``Lambda (u- + u+) / 2``. It is positive where contact
throws it back to less than ``-u-``, and the equality makes up for that: a knob of 1 g m^2 that is coupled 174 : 1 to a burner
whose limit stops it is thrown to what the burner has lost, times 174. No work is done where u+ is -u-, by an elastic
stop, or where there is no impulse, between these stops.
"""

from __future__ import annotations

from impactlaw.solvers.cones import BILATERAL, CONE
from impactlaw.solvers.cones.algebra.loops import indices, kernel, numbers, plain, zeros
from impactlaw.solvers.cones.rows import islands, lengths, trees_of
from impactlaw.stepping.time_stepping.tolerances import DRIVEN

_GONE = 1e12  # compliance of an equality that does nothing, as a multiple of what it resists impulses with


@plain
def _square(sparse, value, row):
    """Return the square of the length of a row."""
    s = 0.0
    for a in range(sparse[1, row], sparse[1, row] + sparse[0, row]):
        s += value[a] * value[a]
    return s


@plain
def _add_work(sparse, value, groups, rates, after, x, collides, label, sums):
    """Add, island by island, (3, islands): work of equalities, of all rows, and the energy of the fastest contact."""
    for g in range(groups.shape[1]):
        if label[g] < 0:
            continue
        row = groups[0, g]
        for k in range(row, row + groups[1, g]):
            work = 0.5 * x[k] * rates[0, k] * (rates[1, k] + after[k])
            sums[1, label[g]] += work
            if groups[2, g] == BILATERAL:
                sums[0, label[g]] += work
        if collides[g]:
            energy = 0.5 * rates[1, row] ** 2 / max(_square(sparse, value, row), 1e-300)
            sums[2, label[g]] = max(sums[2, label[g]], energy)


@plain
def _let_go(sparse, value, groups, rates, x):
    """Let equalities do nothing that are between their stops; return whether there are some that did something."""
    some = False
    for g in range(groups.shape[1]):
        row = groups[0, g]
        if groups[2, g] == BILATERAL and rates[3, row] == -rates[1, row] and x[row] * rates[1, row] < 0.0:
            gone = _GONE * (_square(sparse, value, row) + rates[4, row])
            if rates[4, row] < gone * 1e-6:
                rates[4, row] = gone
                some = True
    return some


@kernel
def turn_back(sparse, colind, value, groups, rates, tree, collides, x, after):
    """Let equalities that drive a collision collide themselves; return whether the problem has changed by that.

    They drive it where they and all rows together add more than `DRIVEN` of the energy of the fastest contact of their
    island. Targets and compliances in rates are written.
    """
    some = _let_go(sparse, value, groups, rates, x)
    many, trees = groups.shape[1], trees_of(tree)
    length, label, parent, number = numbers(many), indices(many), indices(trees), indices(trees)
    lengths(sparse[0], sparse[1], value, groups[0], groups[1], rates[4], length)
    count = islands(
        sparse[0], sparse[1], colind, value, tree, groups[0], groups[1], length, label, parent, number
    )  # fmt: skip
    sums = zeros(3 * count).reshape((3, count))
    _add_work(sparse, value, groups, rates, after, x, collides, label, sums)
    for g in range(many):
        row, i = groups[0, g], label[g]
        if groups[2, g] != BILATERAL or i < 0 or sums[2, i] == 0.0 or min(sums[0, i], sums[1, i]) <= DRIVEN * sums[2, i]:
            continue
        if x[row] * (rates[1, row] + after[row]) > 0.0 and rates[3, row] != -rates[1, row]:
            rates[3, row] = -rates[1, row]
            some = True
    return some
