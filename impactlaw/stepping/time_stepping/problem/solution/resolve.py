"""Resolve the contacts of a step: solve their problem, and compute the velocity and the opening of overlaps."""

from __future__ import annotations

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import FLOATS, counts, numbers, plain
from impactlaw.stepping.compiled.whitening import INERTIA, unwhitened
from impactlaw.stepping.time_stepping.problem.energy import CREATED, contact_work, is_met, lose_energy
from impactlaw.stepping.time_stepping.problem.overlaps import move_apart, overlap_targets
from impactlaw.stepping.time_stepping.problem.rows import ROWS
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import (
    AIMS,
    METHOD,
    UNSOLVED,
    Solution,
    give_way,
    guess,
    shortfall,
    throws,
)
from impactlaw.stepping.time_stepping.problem.solution.driving_equalities import solve_undriven

_MARKS = types.boolean[::1]
_KNOWN = types.Tuple((types.int32[:, ::1], types.int64[::1], FLOATS, FLOATS))
_FOUND = types.Tuple((types.boolean, *[types.float64] * 7))


@plain
def _resolve(
    rows, aims, bound, known, timestep, dissipative, together, method, inertia, change, shift, found, turned, room
):
    """Do the work of `resolve`; ``turned``, (g,), is zero, and ``room``, (3 n + 2 g + 2 nv,), is scratch space."""
    n, g, nv = len(found.x), len(aims.target), len(found.z)
    root, w, need = room[3 * n :][:nv], room[3 * n + nv :][:nv], room[3 * n + 2 * nv :][:g]
    guess(rows, known, found.x)
    share, created, residual = solve_undriven(
        rows, aims, bound, dissipative, together, method, found, turned, room[: 3 * n]
    )
    missed, fastest = shortfall(rows, found.after, found.reached)
    solved = residual <= UNSOLVED
    if (not solved or share == 0.0) and throws(rows, found.z):
        give_way(rows, aims, method, found)
        missed, fastest = shortfall(rows, found.after, found.reached)
        solved, residual = False, max(residual, 1.0)
    if not solved or not is_met(missed, fastest):
        lose_energy(rows, found.reached, method.tree, dissipative and not solved, found.x, found.z, found.after)
        missed, fastest = shortfall(rows, found.after, found.reached)
    for i in range(nv):
        root[i] = np.sqrt(inertia.inverse[i])
    unwhitened(found.z, inertia, root, change)
    overlaps = overlap_targets(rows, found.after, timestep, need)
    if overlaps:
        push = room[3 * n + 2 * nv + g :][:g]
        move_apart(rows, need, timestep, inertia, root, push, w, shift)
    work, total = contact_work(rows, found.after, found.x)
    return overlaps, missed, fastest, share, created, work, CREATED * total, residual


@linked(
    _FOUND(
        ROWS, AIMS, _MARKS, _KNOWN, types.float64, types.boolean, types.boolean, METHOD, INERTIA, *[FLOATS] * 5
    )
)  # fmt: skip
def resolve(rows, aims, bound, known, timestep, dissipative, together, method, inertia, x, change, shift, reached, z):
    """Resolve the contacts of a step.

    Args:
        rows: the rows that take part.
        aims: what the step asks of them; the target sliding velocities are replaced by those aimed at.
        bound: equality constraints that do not drive the collision, see `driving_equalities`, bool (g,).
        known: impulses to start from.
        timestep: h, s.
        dissipative: whether restitution is scaled as needed so that it creates no energy.
        together: whether it is scaled for all contacts alike, as under a law that couples contacts which do not
            influence each other, or for each group of contacts that do.
        method: how to solve the problem; the work of the solvers is subtracted from its `left`.
        inertia: the mass matrix of the step.
        x: impulses, in units of the problem, (n,), written, like the following ones.
        change: change of velocity, (nv,).
        shift: velocity that opens overlaps, (nv,), if there are any to open.
        reached: the targets that were aimed at, with restitution scaled, (g,).
        z: whitened change of velocity, (nv,).

    Returns:
        Whether there are overlaps to open, the largest amount by which a contact velocity misses its target, the
        largest velocity of a row, the smallest share of restitution that is kept, the energy that the collision would
        create without scaling, J, the work of contact and the part of it that is rounding, J, and the residual of the
        natural map, including friction, relative to the largest velocity.
    """
    n, turned = len(x), counts(len(aims.target))
    after, scratch, room = numbers(n), numbers(2 * n), numbers(3 * n + 2 * len(aims.target) + 2 * len(z))
    return _resolve(
        rows, aims, bound, known, timestep, dissipative, together, method, inertia, change, shift,
        Solution(x, z, after, reached, scratch), turned, room,
    )  # fmt: skip
