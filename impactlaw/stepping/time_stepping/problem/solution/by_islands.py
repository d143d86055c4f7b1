"""Scale restitution that creates energy separately for each island of contacts that influence each other."""

from __future__ import annotations

from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import cleared, indices, integers, kernel, numbers, plain, zeros
from impactlaw.solvers.cones.rows import impulse_jump
from impactlaw.stepping.time_stepping.problem.energy import CREATED, add_work, find_islands, row_velocities
from impactlaw.stepping.time_stepping.problem.phases import some_groups
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import UNSOLVED, Aims, Solution, solve_scaled
from impactlaw.stepping.time_stepping.problem.solution.scaling import (
    RESERVE,
    has_restitution,
    judge,
    judged,
    scale_down,
)


@plain
def _may_gain(rows, found):
    """Return whether any contact adds energy; if none does, no island does."""
    for g in range(rows.groups.shape[1]):
        if rows.groups[2, g] == CONE:
            work, total = add_work(rows, rows.rates[1], found.after, found.x, g, 0.0, 0.0)
            if work > CREATED * total:
                return True
    return False


@kernel
def _solve_part(rows, aims, keep, dissipative, method, x, reached):
    """Solve the problem of one island, starting from x; write x, targets and sliding velocities of its groups."""
    part, place = some_groups(rows, keep)
    n, h, at = len(place), part.groups.shape[1], 0
    own = Aims(numbers(h), numbers(n), cleared(h))
    found = Solution(numbers(n), numbers(len(method.tree)), numbers(n), numbers(h), numbers(2 * n))
    for g in range(len(keep)):
        if keep[g]:
            own.target[at], own.collides[at], at = aims.target[g], aims.collides[g], at + 1
    for r in range(n):
        found.x[r], own.sliding[r] = x[place[r]], aims.sliding[place[r]]
    whole = judge(part, own, method, found)
    s, created, residual = scale_down(part, own, dissipative, RESERVE * n / len(x), method, whole, found)
    at = 0
    for g in range(len(keep)):
        if keep[g]:
            reached[g], at = found.reached[at], at + 1
    for r in range(n):
        x[place[r]], aims.sliding[place[r]] = found.x[r], own.sliding[r]
    return s, created, residual


@kernel
def _solve_parts(rows, aims, dissipative, method, whole, found):
    """Solve the problem island by island, if all restitution creates energy or bodies jam.

    The first result is whether there are several islands; with a single island, this function does nothing.
    """
    groups, (residual, _, jammed) = rows.groups, whole
    label, freedom = indices(groups.shape[1]), integers(len(method.tree))
    for i in range(len(freedom)):  # contacts of a tree without common degrees of freedom do not influence each other
        freedom[i] = i
    count = find_islands(rows, freedom, label)
    if count <= 1:
        return False, 1.0, 0.0, residual
    every, keep, sums = jammed or residual > UNSOLVED, cleared(len(label)), zeros(2 * count).reshape((2, count))
    for g in range(len(label)):
        if groups[2, g] == CONE and label[g] >= 0:
            work, total = add_work(rows, rows.rates[1], found.after, found.x, g, 0.0, 0.0)
            sums[0, label[g]] += work
            sums[1, label[g]] += total
    share, created, left_over = 1.0, 0.0, 0.0 if every else residual
    for i in range(count):
        if not every and not sums[0, i] > CREATED * sums[1, i]:
            continue
        for g in range(len(label)):
            keep[g] = label[g] == i
        s, more, rest = _solve_part(rows, aims, keep, dissipative, method, found.x, found.reached)
        share, created, left_over = min(share, s), created + more, max(left_over, rest)
    for g in range(len(label)):
        if every and label[g] < 0 and aims.collides[g]:
            found.reached[g] = min(aims.target[g], 0.0)
    impulse_jump(rows.sparse[0], rows.sparse[1], rows.colind, rows.value, found.x, found.z)
    row_velocities(rows, found.z, found.after)
    return True, share, created, left_over


@plain
def solve_contacts(rows, aims, dissipative, together, method, found):
    """Solve the problem of a step, with restitution scaled so that collisions create no energy.

    Colliding contacts satisfy ``0 <= Lambda  ⊥  J v+ - s gamma^h >= 0``, with friction in its cones. Written are the
    solution, and the remaining target sliding velocities. Return s, the energy that the collision would create with
    s = 1, J, and the residual of the natural map, relative to the largest velocity. Each island has its own s, unless
    contacts are judged `together`; the smallest s is returned.

    With friction there may be no solution if bodies jam. Then s = 0 is tried, which mostly has a solution, and finally
    the problem without friction. The same is done if the impulses found create energy.
    """
    whole = judged(rows, found, solve_scaled(rows, aims, 1.0, method, found), method.left)
    if not together and has_restitution(rows.groups, aims) and (whole[2] or _may_gain(rows, found)):
        several, share, created, residual = _solve_parts(rows, aims, dissipative, method, whole, found)
        if several:
            return share, created, residual
    return scale_down(rows, aims, dissipative, RESERVE, method, whole, found)
