"""Check, after Newton's method has failed, whether bodies jam: slower methods would take hundreds of steps in vain."""

from impactlaw.compiled import compiled
from impactlaw.linked import by_address
from impactlaw.solvers.cones.algebra.loops import counts, indices, numbers, unset
from impactlaw.solvers.cones.algebra.projection import norm_of
from impactlaw.solvers.cones.rows import Problem, islands
from impactlaw.solvers.cones.solve import in_islands, solve_one


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
        members, scale = order[begin[i] : begin[i + 1]], 0.0
        for g in members:
            scale = max(scale, norm_of(b, first[g], first[g] + size[g]) / length[g])
        jammed = jammed or solve_one(members, problem, length, number, seen, b[:0], scale, 0.0, 0, b[:0]) != 0
    return jammed


linked_jams = by_address(jams)
"""The form of `jams` that compiled functions call."""
