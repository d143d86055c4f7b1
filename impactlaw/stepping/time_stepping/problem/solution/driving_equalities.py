"""Equality constraints whose drift would drive a collision: they act as stops instead, and add no energy.

An equality whose velocity changes from u- to u+ does the work ``Lambda (u- + u+) / 2``. If it aims at its drift u-, or
at less, it adds energy when contact pushes it the other way: a knob coupled 174 : 1 to a burner that its limit stops
at 1 m/s would be thrown to 174 rad/s. Such an equality becomes an elastic stop at -u-. Until the stop is reached it has
no impulse, and when it is reached it does no work: contact moves it freely until its drift is reversed.
"""

from __future__ import annotations

from impactlaw.solvers.cones import BILATERAL
from impactlaw.solvers.cones.algebra.loops import any_of, counts, indices, kernel, numbers, plain, put, zeros
from impactlaw.stepping.time_stepping.problem.drifting_equalities import square_of
from impactlaw.stepping.time_stepping.problem.energy import add_work, find_islands
from impactlaw.stepping.time_stepping.problem.solution.by_islands import solve_contacts
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import solve_scaled
from impactlaw.stepping.time_stepping.tolerances import DRIVEN

_GONE = 1e12  # compliance of an inactive equality, as a multiple of everything that resists its impulses
_TURNS = 8  # largest number of times that a problem is searched for such equalities


@plain
def _work_of(rows, base, found, g):
    """Return ``Lambda^T (u + u+) / 2`` of one group, for velocities u."""
    return add_work(rows, base, found.after, found.x, g, 0.0, 0.0)[0]


@plain
def _let_go(rows, turned, x):
    """Deactivate equalities that have not reached their stop; return whether any of them had an impulse."""
    some, rates = False, rows.rates
    for g in range(len(turned)):
        row = rows.groups[0, g]
        if turned[g] == 1 and x[row] * rates[1, row] < 0.0:
            rates[4, row] = _GONE * (square_of(rows, row) + rates[4, row])
            turned[g] = 2
            some = True
    return some


@plain
def _some_work(rows, bound, turned, found):
    """Return whether some equality that may not drive a collision adds energy to it."""
    some = False
    for g in range(len(bound)):
        some = some or (bound[g] and turned[g] == 0 and _work_of(rows, rows.rates[1], found, g) > 0.0)
    return some


@plain
def _add_sums(rows, collides, bound, label, found, sums):
    """Sum for each island, (4, islands): work of such equalities, work with contact, energy of the fastest contact.

    Work with contact is taken both from the velocity before and from the velocity due to forces alone: an equality that
    carries a load during a collision adds energy to the first only. Servos may drive a collision; their work is left
    out.
    """
    for g in range(len(bound)):
        i = label[g]
        if i < 0 or (rows.groups[2, g] == BILATERAL and not bound[g]):
            continue
        work = _work_of(rows, rows.rates[1], found, g)
        sums[1, i] += work
        sums[2, i] += _work_of(rows, rows.rates[2], found, g)
        if bound[g]:
            sums[0, i] += work
        if collides[g]:
            row = rows.groups[0, g]
            sums[3, i] = max(sums[3, i], 0.5 * rows.rates[1, row] ** 2 / max(square_of(rows, row), 1e-300))


@kernel
def _turn(rows, collides, bound, tree, turned, found):
    """Turn equalities that add energy to a collision into stops; return whether there are more of them than before.

    An equality becomes a stop if the equalities of its island, and also these together with its contacts, add more than
    `DRIVEN` of the energy with which the fastest contact of the island collides.
    """
    rates, many = rows.rates, rows.groups.shape[1]
    label = indices(many)
    count = find_islands(rows, tree, label)
    sums, some = zeros(4 * count).reshape((4, count)), False
    _add_sums(rows, collides, bound, label, found, sums)
    for g in range(many):
        i = label[g]
        if not bound[g] or turned[g] != 0 or i < 0 or sums[3, i] == 0.0:
            continue
        driven = min(sums[0, i], sums[1, i], sums[2, i]) > DRIVEN * sums[3, i]
        if driven and _work_of(rows, rates[1], found, g) > 0.0:
            rates[3, rows.groups[0, g]], turned[g] = -rates[1, rows.groups[0, g]], 1
            some = True
    return some


@plain
def _stop(rows, aims, bound, method, turned, found):
    """Turn equalities that would drive the collision, with all its restitution, into stops.

    Equalities that add energy only because of these stops follow. Impulses x become a guess of the solution.
    """
    for _ in range(_TURNS):
        solve_scaled(rows, aims, 1.0, method, found)
        changed = _let_go(rows, turned, found.x)
        if _some_work(rows, bound, turned, found):
            more = _turn(rows, aims.collides, bound, method.tree, turned, found)
            changed = changed or more
        if not changed:
            break


@kernel
def solve_undriven(rows, aims, bound, dissipative, together, method, found):
    """Solve the problem as `solve_contacts` does, with equalities that would drive the collision as stops.

    Only the equalities in ``bound``, (g,), can become stops. Which do depends on the restitution: if the solution
    reduces it, equalities that would then drive the collision become stops, too.
    """
    n, rates, some, turned = len(found.x), rows.rates, any_of(bound), counts(len(bound))
    held, soft, aimed = numbers(n), numbers(n), numbers(n)
    if some:
        put(held, rates[3])
        put(soft, rates[4])
        put(aimed, aims.sliding)
        _stop(rows, aims, bound, method, turned, found)
    while True:
        result = solve_contacts(rows, aims, dissipative, together, method, found)
        if not some or result[0] == 1.0 or not _some_work(rows, bound, turned, found):
            break
        if not _turn(rows, aims.collides, bound, method.tree, turned, found):
            break
        put(aims.sliding, aimed)
    if some:
        put(rates[3], held)
        put(rates[4], soft)
    return result
