"""Scale restitution so that collisions create no energy, and remove it if bodies jam."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones import BILATERAL
from impactlaw.solvers.cones.algebra.loops import clear, copied, kernel, numbers, plain, put
from impactlaw.stepping.time_stepping.problem.energy import CREATED, contact_work, creates, row_velocities, work_since
from impactlaw.stepping.time_stepping.problem.rows import Rows
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import (
    UNSOLVED,
    Solution,
    improve,
    shortfall,
    solve_scaled,
    with_rounds,
    without_friction,
)
from impactlaw.stepping.time_stepping.problem.targets import write_offsets
from impactlaw.stepping.time_stepping.tolerances import SLOWEST

_FEW = 1  # rounds of slower methods in a search
_CLOSE = 1e-10  # part of the exchanged energy of contacts by which a search may end below the allowed energy
_LEAST = 0.1  # share of restitution that is not halved any more
_SEARCHES = 40  # largest number of searches for the share of restitution that creates no energy, while work is left
_OTHER = 1e-6  # part of the exchanged energy above which created energy is not rounding: it is another solution's
_JAMMED = 1e-3  # bodies jam if the law is missed by this part of the largest contact velocity, or by the natural map
RESERVE = 0.2
"""Part of the allowed work that is reserved for a step without restitution; further phases need more."""
_ANY, _NONE = np.inf, np.int64(0)  # natural map and number of rounds of a call that solves nothing
_SAFE = np.int64(8)  # rounds of slower methods for the problem without restitution


@plain
def _root(s, work, points, low, high):
    """Return the zero next to the last point of the parabola through the last three points, or of the line through two.

    Return the middle of the bounds if there is no such zero between them.
    """
    slope, bend = (work[2] - work[1]) / (s[2] - s[1]), 0.0
    if points > 2:
        bend = (slope - (work[1] - work[0]) / (s[1] - s[0])) / (s[2] - s[0])
    slope += bend * (s[2] - s[1])
    square = slope * slope - 4.0 * bend * work[2]
    root = s[2] - 2.0 * work[2] / (slope + np.copysign(np.sqrt(max(square, 0.0)), slope))
    return root if square >= 0.0 and low < root < high else 0.5 * (low + high)


@plain
def _largest(rows, aims, s, allowed, searches, method, found):
    """Return the largest share found, up to s, at which contact creates no more energy than allowed, J.

    Also return the energy created with s beyond that, J. As long as contacts neither open nor begin to slide, the
    energy is a parabola in s. The search is Muller's (Math. Tables Aids Comput. 10, 1956), with bisection if three
    steps do not halve the bounds.
    """
    low, high, most, gained, width, shares, works = 0.0, s, s, 0.0, s, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for search in range(searches):
        solve_scaled(rows, aims, s, method, found)
        work, total = contact_work(rows, found.after, found.x)
        work -= allowed
        if work <= CREATED * total:
            low = s
            if s == most or work > -_CLOSE * total:
                break
        else:
            high, gained = s, work if search == 0 else gained
        if method.left[0] <= 0.0:
            break
        shares, works = (shares[1], shares[2], s), (works[1], works[2], work)
        s = 0.5 * (low + high) if search == 0 else _root(shares, works, search + 1, low, high)
        if search % 3 == 2:
            s, width = s if high - low <= 0.5 * width else 0.5 * (low + high), high - low
    return low, gained


@kernel
def largest_share(rows, aims, known, dissipative, method):
    """Return the largest s found at which a collision creates no energy, what it creates, and what it may create, J.

    The collision alone starts from v- and contains no forces; its contacts do ``Lambda^T (gamma- + gamma+) / 2``. With
    friction, or a matrix E, that can be positive (T. R. Kane, *A dynamics puzzle*, 1984); with s = 0 it is not. If it
    is positive, s is chosen such that the collision creates no energy together with forces either, or no more than
    with s = 0. If the collision need not be `dissipative`, s is 1. The impulses ``known`` are a guess, (n,).

    Of the energies, the first one is what the collision creates alone with s = 1, the second one what it may create
    with forces; infinite if s was not chosen by it.
    """
    n, rates = len(known), rows.rates
    rates_alone = numbers(5 * n).reshape((5, n))
    found = Solution(copied(known), numbers(len(method.tree)), numbers(n), copied(aims.target), numbers(2 * n))
    for i in range(5):
        put(rates_alone[i], rates[1 if i == 2 else i])
    for g in range(len(aims.target)):
        row = rows.groups[0, g]
        if rows.groups[2, g] == BILATERAL and rates[3, row] != -rates[1, row]:  # else a stop, see `driving_equalities`
            rates_alone[3, row] = rates[1, row]
    alone = Rows(rows.sparse, rows.colind, rows.value, rows.groups, rows.key, rows.amounts, rates_alone)
    s, gained = _largest(alone, aims, 1.0, 0.0, _SEARCHES if dissipative else 1, method, found)
    if not dissipative:
        return 1.0, gained, _ANY
    if s == 1.0 or s == 0.0 or method.left[0] <= 0.0:
        return s, gained, _ANY
    put(found.x, known)
    solve_scaled(rows, aims, 0.0, method, found)
    allowed = max(0.0, contact_work(rows, found.after, found.x)[0])
    s, _ = _largest(rows, aims, s, allowed, _SEARCHES, method, found)
    return s, gained, allowed


@plain
def _fails(rows, found, residual):
    """Return whether impulses miss the law by far, or are unsolved and create energy."""
    missed, fastest = shortfall(rows, found.after, found.reached)
    return missed > _JAMMED * max(SLOWEST, fastest) or (residual > UNSOLVED and creates(rows, found.after, found.x))


@plain
def _is_other(rows, found, allowed):
    """Return whether impulses create more energy than allowed, J, and so are not the solution that the search found."""
    work, total = contact_work(rows, found.after, found.x)
    return work - allowed > _OTHER * total and creates(rows, found.after, found.x)


@plain
def _work_of_forces(rows, found):
    """Return by how much the energy that contacts create depends on whether forces act before or after them, J.

    The second result is the smaller one of these energies.
    """
    since, _ = contact_work(rows, found.after, found.x)
    beyond, _ = work_since(rows, rows.rates[2], found.after, found.x)
    return abs(since - beyond), min(since, beyond)


@plain
def judged(rows, found, residual, left):
    """Return the residual of the natural map, whether impulses fail, and whether bodies jam.

    With friction there may be no solution with restitution if bodies jam.
    """
    failed = _fails(rows, found, residual)
    return residual, failed, failed or (residual > _JAMMED and left[0] > 0.0)


@plain
def has_restitution(groups, aims):
    """Return whether any colliding contact has restitution."""
    some = False
    for g in range(len(aims.collides)):
        if aims.collides[g]:
            some = some or aims.target[g] > 0.0
            for k in range(groups[0, g] + 1, groups[0, g] + groups[1, g]):
                some = some or aims.sliding[k] != 0.0
    return some


@plain
def judge(rows, aims, method, found):
    """Return what `judged` does for given impulses x of a part of the contacts, and write the rest of the solution."""
    b = found.room[: len(found.x)]
    put(found.reached, aims.target)
    write_offsets(rows.groups, rows.rates, found.reached, aims.sliding, b)
    residual = improve(rows, with_rounds(method, _NONE), b, _ANY, found.x, found.z)
    row_velocities(rows, found.z, found.after)
    return judged(rows, found, residual, method.left)


@plain
def scale_down(rows, aims, dissipative, reserve, method, whole, found):
    """Scale all restitution so that collisions create no energy, or remove it if bodies jam.

    Contacts with friction can have several solutions. If that of the collision alone creates no energy, but that with
    forces more than the forces explain, or if the last solution creates energy, though that of the search with the same
    share does not, the share is halved until none is created.

    Args:
        rows: see `rows.Rows`.
        aims: what the step asks of the rows; the target sliding velocities that remain are written.
        dissipative: whether restitution is scaled so that it creates no energy.
        reserve: part of the work reserved for a problem without restitution.
        method: how problems are solved.
        whole: the result of `judged` for the solution with all restitution.
        found: that solution; overwritten.

    Returns:
        The result of `by_islands.solve_contacts`.
    """
    (residual, failed, jammed), s, created, allowed, rounds = whole, 1.0, 0.0, _ANY, method.rounds
    some, groups = has_restitution(rows.groups, aims), rows.groups
    if some and not jammed:
        work, total = contact_work(rows, found.after, found.x)
        if work > CREATED * total:
            few = with_rounds(method, min(rounds, _FEW))
            forces, gained = _work_of_forces(rows, found)
            s, created, allowed = largest_share(rows, aims, found.x, dissipative, few)
            if created <= 0.0 and gained - forces > _OTHER * total:
                s, created, allowed = 0.5 if dissipative else 1.0, gained, forces
    while s < 1.0 or (jammed and some):
        if jammed:
            s, method.left[0], rounds = 0.0, max(method.left[0], reserve), max(rounds, _SAFE)
            clear(found.x)
        residual = solve_scaled(rows, aims, s, with_rounds(method, rounds), found)
        failed = _fails(rows, found, residual)
        jammed = failed or residual > _JAMMED
        if s == 0.0 or not (jammed or _is_other(rows, found, allowed)):
            break
        s = 0.5 * s if s > _LEAST else 0.0
    n = len(found.x)
    if failed and without_friction(rows, with_rounds(method, rounds), found.room[n : 2 * n], found.x, found.z):
        row_velocities(rows, found.z, found.after)
        s, residual = 0.0, 0.0
    for g in range(len(aims.collides)):
        if aims.collides[g] and s < 1.0:
            for k in range(groups[0, g] + 1, groups[0, g] + groups[1, g]):
                aims.sliding[k] *= s
    return s, created, residual
