"""Check, after Newton's method has failed, whether bodies jam: slower methods would take hundreds of steps in vain."""

from numba import types

from impactlaw.compiled import compiled
from impactlaw.linked import by_address, linked
from impactlaw.solvers.cones.algebra.loops import FLOATS, INTEGERS, counts, indices, numbers, unset
from impactlaw.solvers.cones.algebra.projection import norm_of
from impactlaw.solvers.cones.convex import out_of_reach
from impactlaw.solvers.cones.islands import build
from impactlaw.solvers.cones.rows import PROBLEM, Problem, islands
from impactlaw.solvers.cones.solve import in_islands


@linked(types.boolean(INTEGERS, PROBLEM, FLOATS, INTEGERS, INTEGERS))
def _one_jams(members, problem, length, number, seen):
    """Do the work of `jams` for the groups of one island."""
    P, K = build(members, problem, length, number, seen)
    scale = 0.0
    for g in range(len(members)):
        scale = max(scale, norm_of(P.b, P.start[g], P.start[g + 1]))
    return out_of_reach(P, K, scale)[1]


@compiled(
    "boolean(int32[::1],int32[::1],int32[::1],float64[::1],int32[::1],int32[::1],int32[::1],int32[::1],float64[::1],"
    "float64[::1],float64[::1],boolean)"
)
def jams(rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, exact):
    """Return whether bodies jam: the convex problem has no solution, see `convex.out_of_reach`.

    All groups must be cones. For the arguments see `solve.solve`.
    """
    groups, jammed = len(first), False
    problem = Problem(rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, exact)
    length, label = numbers(groups), indices(groups)
    count = islands(rownnz, rowadr, colind, value, tree, first, size, compliance, length, label)
    begin, at, order = counts(count + 1), indices(count), indices(groups)
    in_islands(label, begin, at, order)
    number, seen = unset(len(tree)), unset(len(tree))
    for i in range(count):
        jammed = jammed or _one_jams(order[begin[i] : begin[i + 1]], problem, length, number, seen)
    return jammed


linked_jams = by_address(jams)
"""The form of `jams` that compiled functions call."""
