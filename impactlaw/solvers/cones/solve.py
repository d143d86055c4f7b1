"""Contact problems with friction of one time step: one call for any number of rows.

Islands, which share no degree of freedom, are solved one by one. See `structure` for the problem, `hybrid` for the
order of attempts.
"""

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import (
    Array,
    cleared,
    copied,
    counts,
    indices,
    kernel,
    numbers,
    plain,
    put,
    unset,
)
from impactlaw.solvers.cones.elimination import Given, far_from_solved, hold_others, rows_of, write_errors
from impactlaw.solvers.cones.hybrid import FEW, LARGE, solve_island
from impactlaw.solvers.cones.islands import build
from impactlaw.solvers.cones.rows import certificate, impulse_jump, islands, lengths, longest_group, trees_of

_NEAR = 1e2  # tolerances that will do in a large island


@compiled(
    "int64(int64[::1],int32[::1],int32[::1],int32[::1],float64[::1],int32[::1],int32[::1],int32[::1],int32[::1],"
    "float64[::1],float64[::1],float64[::1],float64[::1],boolean,int64[::1],int64[::1],float64[::1],float64,float64,int64,float64[::1])"
)
def _solve_one(
    members, rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, length, exact, number, seen,
    x, scale, tolerance, rounds, left,
):  # fmt: skip
    """Overwrite the impulses of the groups of one island and return the steps taken."""
    P, K = build(
        members, rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, length, exact, number,
        seen,
    )  # fmt: skip
    point = numbers(len(P.b))
    for j in range(len(members)):
        g = members[j]
        for k in range(size[g]):
            point[P.start[j] + k] = x[first[g] + k] * length[g]
    taken, _ = solve_island(P, K, point, scale, tolerance * scale, rounds, left)
    for j in range(len(members)):
        g = members[j]
        for k in range(size[g]):
            x[first[g] + k] = point[P.start[j] + k] / length[g]
    return taken


_linked_one = linked(_solve_one)


@plain
def _clean(first: Array, size: Array, label: Array, x: Array) -> None:
    """Let impulses of groups that cannot move, and those that are no numbers, be 0."""
    for g in range(len(first)):
        if label[g] < 0:
            for i in range(first[g], first[g] + size[g]):
                x[i] = 0.0
    for i in range(len(x)):
        if not abs(x[i]) < 1e100:
            x[i] = 0.0


@plain
def _sort(label: Array, begin: Array, at: Array, order: Array) -> None:
    """Write the groups of the islands, one island after another, and where those of each begin, zeros before."""
    for g in range(len(label)):
        if label[g] >= 0:
            begin[label[g] + 1] += 1
    for i in range(len(at)):
        begin[i + 1] += begin[i]
        at[i] = begin[i]
    for g in range(len(label)):
        if label[g] >= 0:
            order[at[label[g]]] = g
            at[label[g]] += 1


@plain
def _solve_some(G, members, b, number, seen, x, scale, tolerance, rounds, left):
    """Solve the problem of some groups of an island; see `_solve_one`."""
    for i in range(len(number)):
        number[i] = seen[i] = -1
    return _linked_one(
        members, G.rownnz, G.rowadr, G.colind, G.value, G.tree, G.first, G.size, G.kind, G.bound, G.compliance, b,
        G.length, True, number, seen, x, scale, tolerance, rounds, left,
    )  # fmt: skip


@kernel
def _solve_large(G, x, z, scale, tolerance, rounds, left):
    """Do what `_solve_one` does in a large island, where friction is exact; z is that of x, also in the end."""
    error, chosen, room = numbers(len(G.members)), indices(len(G.members)), numbers(2 * longest_group(G.size))
    held, offset, best = numbers(len(z)), numbers(len(G.b)), copied(x)
    number, seen, mark = indices(len(G.tree)), indices(len(G.tree)), cleared(trees_of(G.tree))
    least, some, total = np.inf, 0, 0
    for turn in range(3):
        square = write_errors(G, x, z, error, room)
        if square < least:
            least = square
            put(best, x)
        if turn == 2 or np.sqrt(square) <= _NEAR * tolerance * scale or left[0] <= 0.0:
            break
        some = far_from_solved(G, error, mark, chosen)
        if some == 0:
            break
        hold_others(G, chosen[:some], x, z, held, offset)
        total += _solve_some(
            G, chosen[:some], offset, number, seen, x, scale, _NEAR * tolerance, np.int64(1), left
        )  # fmt: skip
        if turn == 0:
            total += _solve_some(G, G.members, G.b, number, seen, x, scale, tolerance, FEW, left)
        impulse_jump(G.rownnz, G.rowadr, G.colind, G.value, x, z)
    put(x, best)
    if some == 0 and np.sqrt(least) > tolerance * scale:
        total += _solve_some(G, G.members, G.b, number, seen, x, scale, tolerance, rounds, left)
    return total


@compiled(
    "Tuple((float64,int64))(int32[::1],int32[::1],int32[::1],float64[::1],int32[::1],int32[::1],int32[::1],int32[::1],"
    "float64[::1],float64[::1],float64[::1],boolean,float64,int64,float64[::1],float64[::1],float64[::1])"
)
def improve(
    rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, exact, tolerance, rounds, left, x, z
):  # fmt: skip
    """Overwrite a guess x by the solution, write z, and return what else `solve` returns; the arguments are its own.

    `left` (1,) is the part of the work allowed that is left, see `hybrid.spend`: what is done is taken from it, and
    where nothing is left, only the first attempt is made, or all first ones of a convex problem.
    """
    groups, trees = len(first), trees_of(tree)
    length, label, parent, root = numbers(groups), indices(groups), indices(trees), indices(trees)
    lengths(rownnz, rowadr, value, first, size, compliance, length)
    count = islands(rownnz, rowadr, colind, value, tree, first, size, length, label, parent, root)
    scale, squares, room = numbers(count), numbers(count), numbers(2 * longest_group(size))
    _clean(first, size, label, x)
    impulse_jump(rownnz, rowadr, colind, value, x, z)
    worst = certificate(
        rownnz, rowadr, colind, value, first, size, kind, bound, compliance, b, x, z, exact, length, label, scale,
        squares, room,
    )  # fmt: skip
    total = 0
    if worst <= tolerance:
        return worst, total
    begin, at, order = counts(count + 1), indices(count), indices(groups)
    _sort(label, begin, at, order)
    number, seen = unset(len(tree)), unset(len(tree))
    for i in range(count):
        if np.sqrt(squares[i]) <= tolerance * scale[i]:
            continue
        members = order[begin[i] : begin[i + 1]]
        island = Given(
            members, rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, length
        )  # fmt: skip
        if exact and rows_of(island) >= LARGE:
            total += _solve_large(island, x, z, scale[i], tolerance, rounds, left)
        else:
            total += _linked_one(
                members, rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, length, exact,
                number, seen, x, scale[i], tolerance, rounds, left,
            )  # fmt: skip
    impulse_jump(rownnz, rowadr, colind, value, x, z)
    worst = certificate(
        rownnz, rowadr, colind, value, first, size, kind, bound, compliance, b, x, z, exact, length, label, scale,
        squares, room,
    )  # fmt: skip
    return worst, total


linked_improve = linked(improve)
"""What compiled functions call."""


@compiled(
    "Tuple((float64[::1],float64[::1],float64,int64))(int32[::1],int32[::1],int32[::1],float64[::1],int64,int32[::1],"
    "int32[::1],int32[::1],int32[::1],float64[::1],float64[::1],float64[::1],float64[::1],boolean,float64,int64)"
)
def solve(
    rownnz: Array,
    rowadr: Array,
    colind: Array,
    value: Array,
    nv: int,
    tree: Array,
    first: Array,
    size: Array,
    kind: Array,
    bound: Array,
    compliance: Array,
    b: Array,
    x0: Array,
    exact: bool,
    tolerance: float,
    rounds: int,
) -> tuple[Array, Array, float, int]:
    """Return x, ``z = Y^T x``, its relative natural map, and all steps taken.

    Args:
        rownnz: entries of each row of Y, int32, (n,).
        rowadr: first entry of each row, int32, (n,).
        colind: columns of the entries, int32.
        value: the entries; Y is whitened, so that the kinetic metric is Euclidean.
        nv: degrees of freedom.
        tree: kinematic tree of each, int32, (nv,).
        first: first row of each group, int32, (g,).
        size: its rows, int32, (g,).
        kind: `BILATERAL`, `BOX` or `CONE`, int32, (g,).
        bound: of box rows, (g,).
        compliance: added to the diagonal of ``Y Y^T``, (n,).
        b: offset of the velocity, (n,).
        x0: guess, (n,).
        exact: exact Coulomb friction, or its convex relaxation.
        tolerance: of the natural map, relative to the scale of each island.
        rounds: most rounds of what follows where Newton's method fails.
    """
    x, z, left = x0.copy(), np.zeros(nv), np.full(1, np.inf)
    worst, total = linked_improve(
        rownnz, rowadr, colind, value, tree, first, size, kind, bound, compliance, b, exact, tolerance, rounds, left,
        x, z,
    )  # fmt: skip
    return x, z, worst, total


@compiled()
def natural_map(
    rownnz: Array,
    rowadr: Array,
    colind: Array,
    value: Array,
    nv: int,
    tree: Array,
    first: Array,
    size: Array,
    kind: Array,
    bound: Array,
    compliance: Array,
    b: Array,
    exact: bool,
    x: Array,
) -> float:
    """Return the largest relative natural map of all islands at x; the arguments are those of `solve`."""
    groups = len(first)
    z, length, label, trees = np.zeros(nv), np.empty(groups), np.empty(groups, np.int64), trees_of(tree)
    lengths(rownnz, rowadr, value, first, size, compliance, length)
    count = islands(
        rownnz, rowadr, colind, value, tree, first, size, length, label, indices(trees), indices(trees)
    )  # fmt: skip
    impulse_jump(rownnz, rowadr, colind, value, x, z)
    return certificate(
        rownnz, rowadr, colind, value, first, size, kind, bound, compliance, b, x, z, exact, length, label,
        np.empty(count), np.empty(count), np.empty(2 * longest_group(size)),
    )  # fmt: skip
