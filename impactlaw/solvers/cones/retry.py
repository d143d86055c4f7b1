"""Check, after Newton's method has failed, whether bodies jam, and if not, try an interior point method.

Rounds of slower methods would take hundreds of steps to find neither.
"""

import numpy as np
from numba import types

from impactlaw.compiled import compiled
from impactlaw.linked import by_address, linked
from impactlaw.solvers.cones.algebra.loops import FLOATS, INTEGERS, clear, copied, counts, indices, numbers, put, unset
from impactlaw.solvers.cones.algebra.projection import norm_of
from impactlaw.solvers.cones.algebra.structure import delassus
from impactlaw.solvers.cones.convex import out_of_reach
from impactlaw.solvers.cones.interior import interior
from impactlaw.solvers.cones.islands import build
from impactlaw.solvers.cones.newton import DE_SAXCE, newton
from impactlaw.solvers.cones.rows import PROBLEM, Problem, islands
from impactlaw.solvers.cones.solve import in_islands

# largest numbers of steps, of the interior point method and of Newton's method after it, and the latter's patience
_STEPS, _AFTER, _ENDLESS = np.int64(15), np.int64(25), np.int64(1000)
_HANDED_ON = 1e4  # natural map, in tolerances, at which Newton's method takes over
_ONE, _NO_EASE = 1.0, 0.0
_DENSE, _REDUCED = 1e-12, 1e-9  # least regularization of the system of all rows, and of the degrees of freedom


@linked(types.boolean(INTEGERS, PROBLEM, FLOATS, types.float64, FLOATS, INTEGERS, INTEGERS))
def _retry_one(members, problem, length, tolerance, x, number, seen):
    """Do the work of `retry` for the groups of one island."""
    first, size = problem.first, problem.size
    P, K = build(members, problem, length, number, seen)
    scale, n = 0.0, len(P.b)
    for g in range(len(members)):
        scale = max(scale, norm_of(P.b, P.start[g], P.start[g + 1]))
    jams = out_of_reach(P, K, scale)[1]
    if jams or not P.exact or len(K.width) > 1:
        return jams
    few = n <= P.nv
    G, start = numbers(n * n if few else 0), numbers(n)
    if few:
        delassus(P, G)
    for j in range(len(members)):
        for k in range(size[members[j]]):
            start[P.start[j] + k] = x[first[members[j]] + k] * length[members[j]]
    point, least = copied(start), np.inf
    for again in range(2):
        if again:
            clear(point)
        interior(P, K, point, scale, _HANDED_ON * tolerance * scale, _STEPS)
        _, r = newton(
            P, K, G, point, tolerance * scale, _AFTER, DE_SAXCE, _ONE, _DENSE if few else _REDUCED, _NO_EASE, _ENDLESS
        )  # fmt: skip
        if r < least:
            least = r
            put(start, point)
        if least <= tolerance * scale:
            break
    for j in range(len(members)):
        for k in range(size[members[j]]):
            x[first[members[j]] + k] = start[P.start[j] + k] / length[members[j]]
    return False


@compiled(
    "boolean(int32[::1],int32[::1],int32[::1],float64[::1],int32[::1],int32[::1],int32[::1],int32[::1],float64[::1],"
    "float64[::1],float64[::1],boolean,float64,float64[::1])"
)
def retry(
    rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, exact, tolerance, x
):  # fmt: skip
    """Overwrite a guess x by the best point found from the interior; return whether bodies jam.

    Bodies jam if the convex problem has no solution, see `convex.out_of_reach`. All groups must be cones. For the
    arguments see `solve.solve`.
    """
    groups, jammed = len(first), False
    problem = Problem(rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, exact)
    length, label = numbers(groups), indices(groups)
    count = islands(rownnz, rowadr, colind, value, tree, first, size, compliance, length, label)
    begin, at, order = counts(count + 1), indices(count), indices(groups)
    in_islands(label, begin, at, order)
    number, seen = unset(len(tree)), unset(len(tree))
    for i in range(count):
        members = order[begin[i] : begin[i + 1]]
        jammed = jammed or _retry_one(members, problem, length, tolerance, x, number, seen)
    return jammed


linked_retry = by_address(retry)
"""The form of `retry` that compiled functions call."""
