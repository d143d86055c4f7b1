"""The order of attempts: Newton's method from the guess or from zero impulse, from the best point, then slower rounds.

If friction is not unique, Newton's method may cycle. With regularization it often converges from the same guess, with
less of it from the best point found, or else from the result of an interior point method that is started at the best
point, at the guess or at zero impulse. In piles of bodies the interior point method follows at once, unless a pile with
hundreds of coupled rows is nearly solved by then; in such a pile it is the last one. In a large island of a convex
problem Newton's method is followed by augmented Lagrangians only, which come near the solution from any point.

The rounds alternate between the alternating direction method and convex problems with an accelerated correction. Each
of the two continues from its own last point, and is followed by Newton's method with another map, step and
regularization. The best point of all is kept. If work is limited, the rounds end if they have not come near a solution
and the convex problem is found to have none (`convex.out_of_reach`). If they stop near a solution while
work is left, they begin again, from the best point.
"""

import numpy as np

from impactlaw.solvers.cones.admm import admm, largest_eigenvalue
from impactlaw.solvers.cones.algebra.blocks import flops
from impactlaw.solvers.cones.algebra.loops import FIRST, Array, copied, kernel, numbers, once, plain, put
from impactlaw.solvers.cones.algebra.ordering import Blocks
from impactlaw.solvers.cones.algebra.projection import norm_of
from impactlaw.solvers.cones.algebra.structure import BOX, CONE, Island, delassus
from impactlaw.solvers.cones.budget import LARGE, affordable, spend
from impactlaw.solvers.cones.convex import corrected, out_of_reach
from impactlaw.solvers.cones.interior import interior
from impactlaw.solvers.cones.newton import ALART_CURNIER, CONVEX, DE_SAXCE, newton

_FIRST_STEPS = np.array([4, 30, 12, 30])  # Newton steps without and with regularization, from the guess or from zero
_FIRST_MAPS = np.array([ALART_CURNIER, ALART_CURNIER, ALART_CURNIER, DE_SAXCE])
_FIRM = 1.0  # regularization per relative natural map from the guess, which keeps friction near it
_FIRST_EASES = np.array([0.0, _FIRM, 0.0, 1e2])  # regularization per relative natural map
_BEST, _FROM_BEST, _FROM_GUESS, _FROM_REST, _AGAIN = 0, 1, 2, 3, 4
_BEGINS = np.array([_BEST, _FROM_BEST, _AGAIN, _FROM_GUESS, _FROM_REST, _AGAIN, _BEST])
"""Next starting points of Newton's method: the best point; the result of the interior point method started at the best
point, at the guess or at zero impulse; the last of these results again; and the best point again."""
_MAPS = np.array([ALART_CURNIER, ALART_CURNIER, DE_SAXCE, DE_SAXCE, DE_SAXCE, ALART_CURNIER, DE_SAXCE])
_MOST = np.array([15, 25, 25, 25, 25, 25, 25])  # Newton steps of each
_GENTLE = 30.0  # regularization per relative natural map of Newton's method after interior points
_EASES = np.array([0.01, _FIRM, _GENTLE, _GENTLE, _GENTLE, 0.0, 1.0])  # regularization per relative natural map
_CONTENT = 2  # attempt from which a point that is nearly a solution ends them
_HOPEFUL = 1e-2  # relative natural map up to which a solution is likely to exist
_AFTER, _LONG = np.int64(25), np.int64(75)  # Newton steps after each round, in an island of one block and of many
_PATIENCE, _ENDLESS = np.int64(8), np.int64(1000)  # patience of Newton's method
_ONE, _PROXIMAL = np.int64(1), np.int64(8)  # one convex problem, and proximal steps of each
_BRIEF, _HASTE = np.int64(10), np.int64(4)  # Newton steps after each round and patience in large islands
_KINDS = np.array([DE_SAXCE, DE_SAXCE, ALART_CURNIER, DE_SAXCE, ALART_CURNIER, DE_SAXCE, DE_SAXCE, ALART_CURNIER])
_FACTORS = np.array([1.0, 1.0, 1.0, 1.0, 0.1, 0.1, 0.3, 1.0])  # factor of R
_EASE = np.array([0.1, 0.01, 0.0, 0.0, 1.0, 0.1, 0.0, 1.0])  # regularization per relative natural map
_DENSE, _REDUCED = 1e-12, 1e-9  # least regularization of the system of all rows, and of that over degrees of freedom
_LATE = 8  # round from which rounds are longer
_WORK = 1.5e7  # operations after which no further round begins ...
_FACTORIZATIONS = 150.0  # ... or so many factorizations of one block, whichever is more ...
_OF_MANY = 30.0  # ... or so many of many blocks ...
_OF_LARGE = 1.0  # ... or so many in a large island, where Newton's method soon stops making progress
_SET_UP = 4  # cost of setting up a problem, in Newton steps
_ENOUGH, _NEAR = np.int64(4), 1e2  # round from which, and tolerances at which, a degenerate problem counts as solved
_STAGNANT, _HOPELESS = 4, 8  # rounds without an improvement by 10 %, after which to stop if they were long, or anyway
_PILE = 40  # number of rows from which bodies may be a pile
_INTERIOR, _HANDED_ON = np.int64(30), 1e4  # steps of the interior point method, and tolerances at which it ends
_BRIEF_INTERIOR = np.int64(15)  # its steps in large piles
_HURRY = np.int64(2)  # patience of Newton's method in piles before it, and in large piles after it
_CLOSE, _SPARE = 1e-3, 0.25  # relative natural map, and part of the allowed work, for more from the best point
_SHORT = 0.25  # part of the allowed work up to which rounds do not count as long


@plain
def _is_pile(P: Island, K: Blocks) -> bool:
    """Return whether an island has many bodies with exact friction, and no dry friction of joints."""
    return P.exact and len(P.b) >= _PILE and len(K.width) > 1 and not _has_boxes(P)


@plain
def _has_boxes(P: Island) -> bool:
    """Return whether a joint has dry friction."""
    for kind in P.kind:
        if kind == BOX:
            return True
    return False


@kernel
def _solve_pile(P: Island, K: Blocks, x: Array, scale: float, tolerance: float) -> tuple[int, float]:
    """Overwrite the guess x by the best point found; return steps taken and its natural map."""
    dense, one, point, large = numbers(0), 1.0, copied(x), len(x) >= LARGE
    total, least = newton(P, K, dense, x, tolerance, _BRIEF, ALART_CURNIER, one, _REDUCED, _FIRM / scale, _HURRY)
    if least <= (_CLOSE * scale if large else tolerance):
        return total, least
    total += interior(P, K, point, scale, _HANDED_ON * tolerance, _BRIEF_INTERIOR if large else _INTERIOR)
    patience, ease = _HURRY if large else _HASTE, _FIRM / scale
    taken, r = newton(P, K, dense, point, tolerance, _BRIEF, ALART_CURNIER, one, _REDUCED, ease, patience)
    if r < least:
        least = r
        put(x, point)
    return total + taken, least


@kernel
def _solve_large(P: Island, K: Blocks, x: Array, tolerance: float, most: int) -> tuple[int, float]:
    """Solve a large island of a convex problem, without friction or with de Saxcé's correction held.

    Overwrite the guess x by the best point found; return steps taken and its natural map. `tolerance` is the natural
    map at which to stop. No proximal step begins after `most` Newton steps.
    """
    dense, one, none = numbers(0), 1.0, 0.0
    total, least = newton(P, K, dense, x, tolerance, _BRIEF, CONVEX, one, _REDUCED, none, _HASTE)
    if least <= _NEAR * tolerance or most <= total:
        return total, least
    point = copied(x)
    total += corrected(P, K, point, _NEAR * tolerance, _ONE, _PROXIMAL, most - total)
    taken, r = newton(P, K, dense, point, tolerance, _BRIEF, CONVEX, one, _REDUCED, none, _HASTE)
    if r < least:
        least = r
        put(x, point)
    return total + taken, least


@plain
def _solve_one_contact(P: Island, x: Array) -> tuple[int, float]:
    """Solve one contact without friction, in place of `solve_island`: its velocity and its energy are exact."""
    square = P.c[0]
    for a in P.A:
        square += a * a
    x[0] = max(0.0, -P.b[0] / square)
    return 0, 0.0


@once
def solve_island(
    P: Island, K: Blocks, x: Array, scale: float, tolerance: float, rounds: int, left: Array
) -> tuple[int, float]:
    """Overwrite the guess x by the best point found; return steps taken and its natural map.

    `scale` is the scale of the velocities, `tolerance` the natural map at which to stop, `left`, (1,), the remaining
    part of the allowed work, and `rounds` the largest number of rounds.
    """
    n, cost = len(x), flops(P, K)
    if n == 1 and P.kind[0] == CONE:
        return _solve_one_contact(P, x)
    large, total, least = n >= LARGE and len(K.width) > 1, 0, np.inf
    if large and not P.exact:
        total, least = _solve_large(P, K, x, tolerance, affordable(left, cost, n))
        spend(left, (total + _SET_UP) * cost, cost, n)
        return total, least
    if _is_pile(P, K):
        total, least = _solve_pile(P, K, x, scale, tolerance)
        spend(left, (total + _SET_UP) * cost, cost, n)
        if large or rounds < 2 or least <= _NEAR * tolerance or left[0] <= 0.0:
            return total, least
    few = n <= max(P.nv, 6) and float(n) ** 3 <= 1.5 * K.flops + 1e3
    step = cost if not few else float(n) ** 3 + 20.0 * n**2
    spend(left, _SET_UP * step, step, n)
    G = numbers(n * n if few else 0)
    if few:
        delassus(P, G)
    delta = _DENSE if few else _REDUCED
    start, point = copied(x), copied(x)
    patience = _PATIENCE if n < LARGE else _HASTE
    warm, inside = norm_of(x, FIRST, n) > 0.0, rounds > 0 and not large
    for k in range(4):
        if (k < 2) != warm:
            continue
        put(point, start)
        kind, ease = _FIRST_MAPS[k] if P.exact else CONVEX, _FIRST_EASES[k] / scale
        taken, r = newton(P, K, G, point, tolerance, _FIRST_STEPS[k], kind, 1.0, delta, ease, patience)
        total += taken
        spend(left, taken * step, step, n)
        if r < least:
            least = r
            put(x, point)
        if least <= (_NEAR * tolerance if large else tolerance) or (P.exact and left[0] <= 0.0):
            return total, least
    if inside:
        taken, least, ends = _go_on(P, K, G, x, start, least, scale, tolerance, delta, step, left)
        total += taken
        if ends or rounds < 2:
            return total, least
    taken, least = _rounds(P, K, G, x, start, least, scale, tolerance, rounds, few, left)
    total += taken
    if not large and _NEAR * tolerance < least <= _CLOSE * scale and left[0] > _SPARE:
        put(start, x)
        taken, least = _rounds(P, K, G, x, start, least, scale, tolerance, rounds, few, left)
        total += taken
    return total, least


@plain
def _rest(P: Island, x: Array, point: Array) -> None:
    """Write a point with zero impulses of contacts, and with the dry friction of x."""
    for g in range(len(P.kind)):
        for k in range(P.start[g], P.start[g + 1]):
            point[k] = x[k] if P.kind[g] == BOX else 0.0


@kernel
def _go_on(
    P: Island, K: Blocks, G: Array, x: Array, start: Array, least: float, scale: float, tolerance: float, delta: float,
    step: float, left: Array,
) -> tuple[int, float, bool]:  # fmt: skip
    """Continue after Newton's method from the guess, `start`, or from zero impulse; write the best point of all to x.

    Return steps taken, the natural map of that point, and whether to end here, with a solution or without hope of one.
    """
    n, total, dry = len(x), 0, _has_boxes(P)
    inside, point = numbers(n), numbers(n)
    for k in range(len(_BEGINS)):
        taken = 0
        if _BEGINS[k] == _FROM_REST:
            _rest(P, x, inside)
        elif _BEGINS[k] != _AGAIN:
            put(inside, start if _BEGINS[k] == _FROM_GUESS else x)
        if _FROM_BEST <= _BEGINS[k] <= _FROM_REST:
            taken += interior(P, K, inside, scale, _HANDED_ON * tolerance, _INTERIOR)
        put(point, inside)
        kind, ease = _MAPS[k] if P.exact else CONVEX, _EASES[k]
        if dry and _FROM_BEST <= _BEGINS[k] <= _FROM_REST:
            kind, ease = ALART_CURNIER if P.exact else CONVEX, 0.0
        more, r = newton(P, K, G, point, tolerance, _MOST[k], kind, 1.0, delta, ease / scale, _PATIENCE)
        spend(left, (taken + more) * step, step, n)
        total += taken + more
        if r < least:
            least = r
            put(x, point)
        if least <= (_NEAR * tolerance if P.exact and k >= _CONTENT else tolerance) or left[0] <= 0.0:
            return total, least, True
    if left[0] == np.inf or (len(K.width) > 1 and len(G) == 0) or least <= _HOPEFUL * scale:
        return total, least, False
    taken, hopeless = out_of_reach(P, K, scale)
    spend(left, taken * step, step, n)
    return total + taken, least, hopeless


@kernel
def _rounds(
    P: Island, K: Blocks, G: Array, x: Array, start: Array, least: float, scale: float, tolerance: float, rounds: int,
    few: bool, left: Array,
) -> tuple[int, float]:  # fmt: skip
    """Take rounds of slower methods from `start`; keep the best point in x; return steps taken and its natural map."""
    L = largest_eigenvalue(P)
    alternating, convex, point = copied(start), start, numbers(len(x))
    cost, many = flops(P, K), len(K.width) > 1 and not few
    apart = 4.0 * len(P.A) + 10.0 * len(x) + 4.0 * K.size  # operations of a step of alternating directions
    step = cost if not few else float(len(x)) ** 3 + 20.0 * len(x) ** 2
    limit = (_OF_LARGE if len(x) >= LARGE else _OF_MANY) * cost if many else max(_WORK, _FACTORIZATIONS * cost)
    work, total, before, stagnant = 0.0, 0, least, 0
    after, patience = (_LONG, _PATIENCE) if many else (_AFTER, _ENDLESS)
    if many and len(x) >= LARGE:
        after, patience = _BRIEF, _HASTE
    for k in range(rounds):
        done = work
        if k % 2 == 0:
            taken = admm(P, K, L, alternating, tolerance, 50 if k < _LATE else 150)
            work += taken * apart + 3.0 * cost
            put(point, alternating)
        elif many and k < _LATE:  # convex problems cost more than Newton steps from the best point
            taken = 0
            put(point, x)
        else:
            most = affordable(left, cost, len(x))
            taken = corrected(P, K, convex, 1e2 * tolerance, 3 if k < _LATE else 6, _PROXIMAL, most)
            work += taken * cost
            put(point, convex)
        total += taken
        v = k % len(_EASE)
        kind = CONVEX if not P.exact else _KINDS[v]
        delta = _DENSE if few else _REDUCED
        taken, r = newton(P, K, G, point, tolerance, after, kind, _FACTORS[v], delta, _EASE[v] / scale, patience)
        total += taken
        work += taken * step
        spend(left, work - done, step, len(x))
        if r < least:
            least = r
            put(x, point)
        if least <= tolerance or work > limit or left[0] <= 0.0 or (k >= _ENOUGH and least <= _NEAR * tolerance):
            break
        stagnant = 0 if least < 0.9 * before else stagnant + 1
        before = min(before, least) if stagnant == 0 else before
        if stagnant >= _HOPELESS or (stagnant >= _STAGNANT and work > _SHORT * limit):
            break
    return total, least
