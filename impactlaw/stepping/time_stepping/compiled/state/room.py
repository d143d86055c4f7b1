"""Memory for the contact problem of a step: one block, with views that are made where they are needed.

Views are not reference-counted: the block lives as long as the step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from impactlaw.solvers.cones.algebra.loops import kernel, plain, put
from impactlaw.stepping.compiled.fields import bools, floats, ints, longs
from impactlaw.stepping.time_stepping.problem.rows import Known, Rows

Array = np.ndarray[Any, Any]
SUMS = 6
"""Number of sums over the collisions of a step, see `impulses.sums`."""


class Room(NamedTuple):
    """Addresses of arrays for the contact problem of a step, and their sizes."""

    rows: int  # address of `Rows`
    answer: int  # address of `Answer`
    known: int  # address of `Known`
    velocities: int  # address of velocities, (`VELOCITIES`, nv)
    sums: int  # address of sums over the collisions, see `impulses.sums`
    entries: int  # largest number of entries of whitened rows
    nv: int  # degrees of freedom


class Answer(NamedTuple):
    """Targets and results of the contacts; see `resolve.resolve`."""

    x: Array  # impulses of rows, in units of the problem, (n,)
    sliding: Array  # target sliding velocities, (n,)
    target: Array  # target velocities with all restitution, (g,)
    reached: Array  # the targets that were actually aimed at, (g,)
    change: Array  # change of velocity, (nv,)
    shift: Array  # velocity that opens overlaps, (nv,), if there are any to open
    z: Array  # whitened change of velocity, (nv,)
    may: Array  # which groups may collide, bool (g,)
    collides: Array  # which groups collide, bool (g,)
    later: Array  # which groups are hit only through others, bool (g,)
    bound: Array  # which groups are equality constraints that must not drive the collision, bool (g,)


VELOCITIES = 10
"""Number of velocities, (nv,) each, that there is room for."""


@plain
def rows_size(g, n, m):
    """Return the number of 64-bit numbers for rows of g groups, n rows and m entries."""
    return m + 7 * n + 5 * g + (3 * n + 1) // 2 + (m + 1) // 2


@plain
def answer_size(g, n, nv):
    """Return the number of 64-bit numbers for an answer."""
    return 2 * n + 2 * g + 3 * nv + (4 * g + 7) // 8


@plain
def lay_out(at, n, m, nv):
    """Return the `Room` for n rows and m entries at an address, and the number of its 64-bit numbers."""
    answer = at + 8 * rows_size(n, n, m)
    known = answer + 8 * answer_size(n, n, nv)
    velocities = known + 8 * (3 * n + 4 * n)
    sums = velocities + 8 * VELOCITIES * nv
    return Room(at, answer, known, velocities, sums, m, nv), (sums - at) // 8 + SUMS


@kernel
def rows_at(at, g, n, m):
    """Return the `Rows` of g groups, n rows and room for m entries at an address."""
    rates = at + 8 * m
    amounts = rates + 56 * n
    key = amounts + 16 * g
    groups = key + 8 * g
    sparse = groups + 16 * g
    colind = sparse + 8 * ((3 * n + 1) // 2)
    return Rows(
        ints(sparse, (3, n)), ints(colind, m), floats(at, m), ints(groups, (4, g)), longs(key, g),
        floats(amounts, (2, g)), floats(rates, (7, n)),
    )  # fmt: skip


@kernel
def answer_at(at, g, n, nv):
    """Return the `Answer` at an address."""
    sliding = at + 8 * n
    target = sliding + 8 * n
    reached = target + 8 * g
    change = reached + 8 * g
    shift = change + 8 * nv
    z = shift + 8 * nv
    may = z + 8 * nv
    return Answer(
        floats(at, n), floats(sliding, n), floats(target, g), floats(reached, g), floats(change, nv), floats(shift, nv),
        floats(z, nv), bools(may, g), bools(may + g, g), bools(may + 2 * g, g), bools(may + 3 * g, g),
    )  # fmt: skip


@kernel
def velocities_at(room, first, many):
    """Return some of the velocities as scratch space, (many nv,)."""
    return floats(room.velocities + 8 * first * room.nv, many * room.nv)


@kernel
def known_at(at, g, n):
    """Return what is `Known` of g groups and n rows at an address."""
    scale = at + 8 * g
    impulses = scale + 8 * n
    turns = impulses + 8 * n
    groups = ints(turns + 16 * n, (4, g))
    return Known(groups, longs(at, g), floats(scale, n), floats(impulses, n), floats(turns, (2, n)))


@plain
def keep_known(known, rows, impulses):
    """Copy what is known of rows and of their impulses."""
    for k in range(4):
        put(known.groups[k], rows.groups[k])
    put(known.key, rows.key)
    put(known.scale, rows.rates[0])
    put(known.impulse, impulses)
    for k in range(2):
        put(known.turns[k], rows.rates[5 + k])
