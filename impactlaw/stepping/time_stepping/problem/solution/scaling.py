"""Scale restitution so that collisions create no energy, and remove it if bodies jam."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones import BILATERAL
from impactlaw.solvers.cones.algebra.loops import clear, copied, kernel, numbers, plain, put
from impactlaw.solvers.cones.solve import linked_improve
from impactlaw.stepping.time_stepping.problem.energy import CREATED, contact_work, creates, row_velocities
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import (
    UNSOLVED,
    shortfall,
    solve_scaled,
    without_friction,
)
from impactlaw.stepping.time_stepping.problem.targets import write_offsets
from impactlaw.stepping.time_stepping.tolerances import SLOWEST

_FEW = 1  # rounds of slower methods in a search
_CLOSE = 1e-10  # part of the exchanged energy of contacts by which a search may end below the allowed energy
_SEARCHES = 40  # largest number of searches for the share of restitution that creates no energy, while work is left
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
def _largest(
    sparse, colind, value, groups, amounts, rates, target, sliding, collides, s, allowed, searches, tree, exact, rounds,
    left, x, z, after, scaled, room,
):  # fmt: skip
    """Return the largest share found, up to s, at which contact creates no more energy than allowed, J.

    Also return the energy created with s beyond that, J. The outputs are those of `solve_scaled`. As long as contacts
    neither open nor begin to slide, the energy is a parabola in s. The search is Muller's (Math. Tables Aids Comput.
    10, 1956), with bisection if three steps do not halve the bounds.
    """
    low, high, most, gained, width, shares, works = 0.0, s, s, 0.0, s, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for search in range(searches):
        solve_scaled(
            sparse, colind, value, groups, amounts, rates, target, sliding, collides, s, tree, exact, rounds, left,
            x, z, after, scaled, room,
        )  # fmt: skip
        work, total = contact_work(groups, rates, after, x)
        work -= allowed
        if work <= CREATED * total:
            low = s
            if s == most or work > -_CLOSE * total:
                break
        else:
            high, gained = s, work if search == 0 else gained
        if left[0] <= 0.0:
            break
        shares, works = (shares[1], shares[2], s), (works[1], works[2], work)
        s = 0.5 * (low + high) if search == 0 else _root(shares, works, search + 1, low, high)
        if search % 3 == 2:
            s, width = s if high - low <= 0.5 * width else 0.5 * (low + high), high - low
    return low, gained


@kernel
def largest_share(
    sparse, colind, value, groups, amounts, rates, target, sliding, collides, known, tree, exact, dissipative, rounds,
    left,
):  # fmt: skip
    """Return the largest s found at which a collision creates no energy, and the energy it creates alone with s = 1, J.

    The collision alone starts from v- and contains no forces; its contacts do ``Lambda^T (gamma- + gamma+) / 2``. With
    friction, or a matrix E, that can be positive (T. R. Kane, *A dynamics puzzle*, 1984); with s = 0 it is not. If it
    is positive, s is chosen such that the collision creates no energy together with forces either, or no more than
    with s = 0. If the collision need not be `dissipative`, s is 1.
    """
    n = rates.shape[1]
    alone, x, z = numbers(5 * n).reshape((5, n)), copied(known), numbers(len(tree))
    after, scaled, room = numbers(n), copied(target), numbers(2 * n)
    for i in range(5):
        put(alone[i], rates[1 if i == 2 else i])
    for g in range(len(target)):
        row = groups[0, g]
        if groups[2, g] == BILATERAL and rates[3, row] != -rates[1, row]:  # otherwise it is a stop, see `driven`
            alone[3, row] = rates[1, row]
    s, gained = _largest(
        sparse, colind, value, groups, amounts, alone, target, sliding, collides, 1.0, 0.0,
        _SEARCHES if dissipative else 1, tree, exact, rounds, left, x, z, after, scaled, room,
    )  # fmt: skip
    if not dissipative:
        return 1.0, gained
    if s == 1.0 or s == 0.0 or left[0] <= 0.0:
        return s, gained
    put(x, known)
    solve_scaled(
        sparse, colind, value, groups, amounts, rates, target, sliding, collides, 0.0, tree, exact, rounds, left,
        x, z, after, scaled, room,
    )  # fmt: skip
    allowed = max(0.0, contact_work(groups, rates, after, x)[0])
    s, _ = _largest(
        sparse, colind, value, groups, amounts, rates, target, sliding, collides, s, allowed, _SEARCHES, tree, exact,
        rounds, left, x, z, after, scaled, room,
    )  # fmt: skip
    return s, gained


@plain
def _fails(groups, rates, after, reached, x, residual):
    """Return whether impulses miss the law by far, or are unsolved and create energy."""
    missed, fastest = shortfall(groups, rates, after, reached)
    return missed > _JAMMED * max(SLOWEST, fastest) or (residual > UNSOLVED and creates(groups, rates, after, x))


@plain
def _judged(groups, rates, after, reached, x, residual, left):
    """Return the residual of the natural map, whether impulses fail, and whether bodies jam."""
    failed = _fails(groups, rates, after, reached, x, residual)
    return residual, failed, failed or (residual > _JAMMED and left[0] > 0.0)


@plain
def has_restitution(groups, target, sliding, collides):
    """Return whether any colliding contact has restitution."""
    some = False
    for g in range(len(collides)):
        if collides[g]:
            some = some or target[g] > 0.0
            for k in range(groups[0, g] + 1, groups[0, g] + groups[1, g]):
                some = some or sliding[k] != 0.0
    return some


@plain
def solve_whole(
    sparse, colind, value, groups, amounts, rates, target, sliding, collides, tree, exact, rounds, left,
    x, z, after, scaled, room,
):  # fmt: skip
    """Solve the problem with all restitution; return the residual, whether impulses fail, and whether bodies jam.

    The outputs are those of `solve_scaled`. With friction there may be no solution if bodies jam.
    """
    residual = solve_scaled(
        sparse, colind, value, groups, amounts, rates, target, sliding, collides, 1.0, tree, exact, rounds, left,
        x, z, after, scaled, room,
    )  # fmt: skip
    return _judged(groups, rates, after, scaled, x, residual, left)


@plain
def judge(
    sparse, colind, value, groups, amounts, rates, target, sliding, tree, exact, left, x, z, after, scaled, room
):  # fmt: skip
    """Return and write the results of `solve_whole` for a part of its contacts, with given impulses x."""
    b = room[: len(x)]
    put(scaled, target)
    write_offsets(groups, rates, scaled, sliding, b)
    residual, _ = linked_improve(
        sparse[0], sparse[1], colind, value, tree, groups[0], groups[1], groups[2], amounts[1], rates[4], b, exact,
        _ANY, _NONE, left, x, z,
    )  # fmt: skip
    row_velocities(sparse, colind, value, rates, z, after)
    return _judged(groups, rates, after, scaled, x, residual, left)


@plain
def scale_down(
    sparse, colind, value, groups, amounts, rates, target, sliding, collides, tree, exact, dissipative, rounds, left,
    reserve, found, x, z, after, scaled, room,
):  # fmt: skip
    """Scale all restitution so that collisions create no energy, or remove it if bodies jam.

    Args:
        sparse: see `rows.Rows`, like the next five.
        colind: see `rows.Rows`.
        value: see `rows.Rows`.
        groups: see `rows.Rows`.
        amounts: see `rows.Rows`.
        rates: see `rows.Rows`.
        target: ``gamma^h``, (g,).
        sliding: target sliding velocities, (n,); those that remain are written.
        collides: which groups collide, bool (g,).
        tree: tree of each degree of freedom, (nv,).
        exact: exact Coulomb friction, or its convex relaxation.
        dissipative: whether restitution is scaled so that it creates no energy.
        rounds: rounds of the slower solvers.
        left: remaining part of the allowed work, (1,).
        reserve: part of the work reserved for a problem without restitution.
        found: the result of `solve_whole`.
        x: outputs of `solve_whole`, like the next four; overwritten.
        z: see `solve_whole`.
        after: see `solve_whole`.
        scaled: see `solve_whole`.
        room: scratch space.

    Returns:
        The result of `apart.solve_contacts`.
    """
    (residual, failed, jammed), s, created = found, 1.0, 0.0
    some = has_restitution(groups, target, sliding, collides)
    if some and not jammed:
        work, total = contact_work(groups, rates, after, x)
        if work > CREATED * total:
            s, created = largest_share(
                sparse, colind, value, groups, amounts, rates, target, sliding, collides, x, tree, exact,
                dissipative, min(rounds, _FEW), left,
            )  # fmt: skip
    while s < 1.0 or (jammed and some):
        if jammed:
            s, left[0], rounds = 0.0, max(left[0], reserve), max(rounds, _SAFE)
            clear(x)
        residual = solve_scaled(
            sparse, colind, value, groups, amounts, rates, target, sliding, collides, s, tree, exact, rounds, left,
            x, z, after, scaled, room,
        )  # fmt: skip
        failed = _fails(groups, rates, after, scaled, x, residual)
        jammed = failed or residual > _JAMMED
        if not jammed or s == 0.0:
            break
    if failed and without_friction(
        sparse, colind, value, groups, amounts, rates, room[len(x) : 2 * len(x)], tree, rounds, left, x, z
    ):  # fmt: skip
        row_velocities(sparse, colind, value, rates, z, after)
        s, residual = 0.0, 0.0
    for g in range(len(collides)):
        if collides[g] and s < 1.0:
            for k in range(groups[0, g] + 1, groups[0, g] + groups[1, g]):
                sliding[k] *= s
    return s, created, residual
