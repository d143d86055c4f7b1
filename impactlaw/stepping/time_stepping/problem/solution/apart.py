"""Scale restitution that creates energy separately for each island of contacts that influence each other."""

from __future__ import annotations

from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import cleared, indices, integers, kernel, numbers, plain, zeros
from impactlaw.solvers.cones.rows import impulse_jump
from impactlaw.stepping.time_stepping.problem.energy import CREATED, add_work, find_islands, row_velocities
from impactlaw.stepping.time_stepping.problem.phases import some_groups
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import UNSOLVED
from impactlaw.stepping.time_stepping.problem.solution.scaling import (
    RESERVE,
    has_restitution,
    judge,
    scale_down,
    solve_whole,
)


@plain
def _may_gain(groups, rates, after, x):
    """Return whether any contact adds energy; if none does, no island does."""
    for g in range(groups.shape[1]):
        if groups[2, g] == CONE:
            work, total = add_work(groups, rates[1], after, x, rates[0], g, 0.0, 0.0)
            if work > CREATED * total:
                return True
    return False


@kernel
def _solve_part(
    sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, keep, tree, exact, dissipative,
    rounds, left, x, scaled,
):  # fmt: skip
    """Solve the problem of one island, starting from x; write x, targets and sliding velocities of its groups."""
    part, place = some_groups(sparse, colind, value, groups, key, amounts, rates, keep)
    table, columns, values, kinds, _, gaps, own = part
    n, h, at = len(place), kinds.shape[1], 0
    impulse, aimed, after, room, z = numbers(n), numbers(n), numbers(n), numbers(2 * n), numbers(len(tree))
    wanted, reached, hits = numbers(h), numbers(h), cleared(h)
    for g in range(len(keep)):
        if keep[g]:
            wanted[at], hits[at], at = target[g], collides[g], at + 1
    for r in range(n):
        impulse[r], aimed[r] = x[place[r]], sliding[place[r]]
    found = judge(
        table, columns, values, kinds, gaps, own, wanted, aimed, tree, exact, left, impulse, z, after, reached, room
    )  # fmt: skip
    s, created, residual = scale_down(
        table, columns, values, kinds, gaps, own, wanted, aimed, hits, tree, exact, dissipative, rounds, left,
        RESERVE * n / len(x), found, impulse, z, after, reached, room,
    )  # fmt: skip
    at = 0
    for g in range(len(keep)):
        if keep[g]:
            scaled[g], at = reached[at], at + 1
    for r in range(n):
        x[place[r]], sliding[place[r]] = impulse[r], aimed[r]
    return s, created, residual


@kernel
def _solve_parts(
    sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, tree, exact, dissipative, rounds,
    left, found, x, z, after, scaled,
):  # fmt: skip
    """Solve the problem island by island, if `solve_whole` has found that energy is created or bodies jam.

    The first result is whether there are several islands; with a single island, this function does nothing.
    """
    residual, _, jammed = found
    label, freedom = indices(groups.shape[1]), integers(len(tree))
    for i in range(len(tree)):  # contacts of a tree without common degrees of freedom do not influence each other
        freedom[i] = i
    count = find_islands(sparse, colind, value, groups, rates, freedom, label)
    if count <= 1:
        return False, 1.0, 0.0, residual
    every, keep, sums = jammed or residual > UNSOLVED, cleared(len(label)), zeros(2 * count).reshape((2, count))
    for g in range(len(label)):
        if groups[2, g] == CONE and label[g] >= 0:
            work, total = add_work(groups, rates[1], after, x, rates[0], g, 0.0, 0.0)
            sums[0, label[g]] += work
            sums[1, label[g]] += total
    share, created, left_over = 1.0, 0.0, 0.0 if every else residual
    for i in range(count):
        if not every and not sums[0, i] > CREATED * sums[1, i]:
            continue
        for g in range(len(label)):
            keep[g] = label[g] == i
        s, more, rest = _solve_part(
            sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, keep, tree, exact,
            dissipative, rounds, left, x, scaled,
        )  # fmt: skip
        share, created, left_over = min(share, s), created + more, max(left_over, rest)
    for g in range(len(label)):
        if every and label[g] < 0 and collides[g]:
            scaled[g] = min(target[g], 0.0)
    impulse_jump(sparse[0], sparse[1], colind, value, x, z)
    row_velocities(sparse, colind, value, rates, z, after)
    return True, share, created, left_over


@plain
def solve_contacts(
    sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, tree, exact, dissipative, together,
    rounds, left, x, z, after, scaled, room,
):  # fmt: skip
    """Solve the problem of a step, with restitution scaled so that collisions create no energy.

    Colliding contacts satisfy ``0 <= Lambda  ⊥  J v+ - s gamma^h >= 0``, with friction in its cones. The outputs are
    those of `solve_scaled`, and the remaining target sliding velocities. Return s, the energy that the collision would
    create with s = 1, J, and the residual of the natural map, relative to the largest velocity. Each island has its own
    s, unless contacts are judged `together`; the smallest s is returned.

    With friction there may be no solution if bodies jam. Then s = 0 is tried, which mostly has a solution, and finally
    the problem without friction. The same is done if the impulses found create energy.
    """
    found = solve_whole(
        sparse, colind, value, groups, amounts, rates, target, sliding, collides, tree, exact, rounds, left, x, z,
        after, scaled, room,
    )  # fmt: skip
    some = not together and has_restitution(groups, target, sliding, collides)
    if some and (found[2] or _may_gain(groups, rates, after, x)):
        several, share, created, residual = _solve_parts(
            sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, tree, exact, dissipative,
            rounds, left, found, x, z, after, scaled,
        )  # fmt: skip
        if several:
            return share, created, residual
    return scale_down(
        sparse, colind, value, groups, amounts, rates, target, sliding, collides, tree, exact, dissipative, rounds,
        left, RESERVE, found, x, z, after, scaled, room,
    )  # fmt: skip
