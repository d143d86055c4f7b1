"""Resolve the contacts of a step: solve their problem, and compute the velocity and the opening of overlaps."""

from __future__ import annotations

import numpy as np

from impactlaw.compiled import compiled
from impactlaw.linked import by_address
from impactlaw.solvers.cones.algebra.loops import counts, numbers, plain
from impactlaw.stepping.compiled.whitening import unwhitened
from impactlaw.stepping.time_stepping.problem.energy import CREATED, contact_work, is_held, is_met, lose_energy
from impactlaw.stepping.time_stepping.problem.overlaps import move_apart, overlap_targets
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import UNSOLVED, guess, shortfall
from impactlaw.stepping.time_stepping.problem.solution.driven import solve_undriven

_ARRAYS = (
    "int32[:,::1],int32[::1],float64[::1],int32[:,::1],int64[::1],float64[:,::1],float64[:,::1],float64[::1],"
    "float64[::1],boolean[::1],boolean[::1],int32[:,::1],int64[::1],float64[::1],float64[::1],float64,boolean,boolean,"
    "boolean,int64,float64[::1],int32[::1],float64[::1],float64[::1],int32[::1],int32[::1],int32[::1]"
)
_FOUND = "boolean,float64,float64,float64,float64,float64,float64,float64"


@plain
def _some_held(groups, amounts, rates):
    """Return whether an equality constraint keeps its velocity in a collision."""
    some = False
    for g in range(groups.shape[1]):
        some = some or is_held(groups, amounts, rates, g)
    return some


@plain
def _resolve(
    sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, bound,
    known_groups, known_key, known_scale, known, timestep, exact, dissipative, together, rounds, left, tree,
    factor, inverse, Mnnz, Madr, Mcol, x, change, shift, reached, z, turned, room,
):  # fmt: skip
    """Do the work of `resolve`; ``turned``, (g,), is zero, and ``room``, (6 n + 2 g + 2 nv,), is scratch space."""
    n, g, nv = len(x), len(target), len(z)
    after, root, w = room[:n], room[n : n + nv], room[n + nv : n + 2 * nv]
    need, push, rest = room[n + 2 * nv :][:g], room[n + 2 * nv + g :][:g], room[n + 2 * nv + 2 * g :]
    guess(groups, key, rates[0], known_groups, known_key, known_scale, known, x)
    share, created, residual = solve_undriven(
        sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, bound, tree, exact, dissipative,
        together, rounds, left, x, z, after, reached, turned, rest,
    )  # fmt: skip
    missed, fastest = shortfall(groups, rates, after, reached)
    solved = residual <= UNSOLVED
    if _some_held(groups, amounts, rates) or not solved or not is_met(missed, fastest):
        lose_energy(
            sparse, colind, value, groups, amounts, rates, reached, tree, dissipative and not solved, x, z, after
        )
        missed, fastest = shortfall(groups, rates, after, reached)
    for i in range(nv):
        root[i] = np.sqrt(inverse[i])
    unwhitened(z, factor, Mnnz, Madr, Mcol, root, change)
    overlaps = overlap_targets(groups, amounts, rates, after, timestep, need)
    if overlaps:
        move_apart(sparse, colind, value, groups, rates, need, timestep, factor, root, Mnnz, Madr, Mcol, push, w, shift)
    work, total = contact_work(groups, rates, after, x)
    return overlaps, missed, fastest, share, created, work, CREATED * total, residual


@compiled(f"Tuple(({_FOUND}))({_ARRAYS},float64[::1],float64[::1],float64[::1],float64[::1],float64[::1])")
def resolve(
    sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, bound,
    known_groups, known_key, known_scale, known, timestep, exact, dissipative, together, rounds, left, tree,
    factor, inverse, Mnnz, Madr, Mcol, x, change, shift, reached, z,
):  # fmt: skip
    """Resolve the contacts of a step, writing to given arrays; see `resolve_step`.

    Written are the impulses, the change of velocity, the velocity that opens overlaps if there are any to open, the
    targets, the whitened change of velocity, and the target sliding velocities, which replace the given ones.
    Return whether there are overlaps to open, and the numbers of `resolve_step`.
    """
    turned, room = counts(len(target)), numbers(6 * len(x) + 2 * len(target) + 2 * len(z))
    return _resolve(
        sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, bound,
        known_groups, known_key, known_scale, known, timestep, exact, dissipative, together, rounds, left, tree,
        factor, inverse, Mnnz, Madr, Mcol, x, change, shift, reached, z, turned, room,
    )  # fmt: skip


linked_resolve = by_address(resolve)
"""The version of `resolve` that compiled functions call."""


@compiled(
    "Tuple((float64[::1],float64[::1],float64[::1],float64[::1],float64,float64,float64,float64,float64,float64,"
    f"float64,float64[::1],float64[::1]))({_ARRAYS})"
)
def resolve_step(
    sparse, colind, value, groups, key, amounts, rates, target, sliding, collides, bound,
    known_groups, known_key, known_scale, known, timestep, exact, dissipative, together, rounds, left, tree,
    factor, inverse, Mnnz, Madr, Mcol,
):  # fmt: skip
    """Resolve the contacts of a step.

    Equality constraints that are `bound`, bool (g,), do not drive the collision, see `driven`. Restitution that creates
    energy is scaled for each group of contacts that influence each other, or for all of them `together`, as needed
    under a law that couples other contacts.

    The work of the solvers is subtracted from `left` (1,), the part of the work allowed in the step, see
    `solvers.cones.budget`.

    Returns:
        Impulses (n,), in units of the problem; the change of velocity (nv,); the velocity that opens overlaps (nv,),
        empty if there is none to open; the targets reached for (g,); the largest amount by which a contact velocity
        misses its target, and the largest velocity of a row, m/s or rad/s; the smallest share s of restitution; the
        energy that the collision would create without scaling, J; the work of contact, J, and the part of it that is
        rounding; the residual of the natural map, including friction, relative to the largest velocity; the whitened
        change of velocity (nv,); and the target sliding velocities (n,).
    """
    x, z = np.empty(rates.shape[1]), np.empty(len(tree))
    change, shift, reached = np.empty(len(tree)), np.empty(len(tree)), np.empty(len(target))
    aimed = sliding.copy()
    overlaps, missed, fastest, s, created, work, rounding, residual = linked_resolve(
        sparse, colind, value, groups, key, amounts, rates, target, aimed, collides, bound,
        known_groups, known_key, known_scale, known, timestep, exact, dissipative, together, rounds, left, tree,
        factor, inverse, Mnnz, Madr, Mcol, x, change, shift, reached, z,
    )  # fmt: skip
    shift = shift if overlaps else shift[:0]
    return x, change, shift, reached, missed, fastest, s, created, work, rounding, residual, z, aimed
