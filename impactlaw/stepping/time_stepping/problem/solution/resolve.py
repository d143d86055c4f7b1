"""Resolve the contacts of a step: solve their problem, and compute the velocity and the opening of overlaps."""

from __future__ import annotations

import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import FLOATS, numbers
from impactlaw.stepping.compiled.whitening import INERTIA, unwhitened
from impactlaw.stepping.time_stepping.problem.energy import CREATED, contact_work, is_met, lose_energy
from impactlaw.stepping.time_stepping.problem.overlaps import open_overlaps, overlap_targets
from impactlaw.stepping.time_stepping.problem.rows import KNOWN, ROWS
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
_FOUND = types.Tuple((types.boolean, *[types.float64] * 7))


@linked(
    _FOUND(
        ROWS, AIMS, _MARKS, KNOWN, types.float64, types.boolean, types.boolean, METHOD, INERTIA, *[FLOATS] * 5
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
    n, nv, need = len(x), len(z), numbers(len(reached))
    root, found = numbers(nv), Solution(x, z, numbers(n), reached, numbers(2 * n))
    guess(rows, known, x)
    share, created, residual = solve_undriven(rows, aims, bound, dissipative, together, method, found)
    missed, fastest = shortfall(rows, found.after, reached)
    solved = residual <= UNSOLVED
    if (not solved or share == 0.0) and throws(rows, z):
        give_way(rows, aims, method, found)
        missed, fastest = shortfall(rows, found.after, reached)
        solved, residual = False, max(residual, 1.0)
    if not solved or not is_met(missed, fastest):
        lose_energy(rows, reached, method.tree, dissipative and not solved, x, z, found.after)
        missed, fastest = shortfall(rows, found.after, reached)
    for i in range(nv):
        root[i] = np.sqrt(inertia.inverse[i])
    unwhitened(z, inertia, root, change)
    overlaps = overlap_targets(rows, found.after, timestep, need)
    if overlaps:
        open_overlaps(rows, need, timestep, inertia, shift)
    work, total = contact_work(rows, found.after, x)
    return overlaps, missed, fastest, share, created, work, CREATED * total, residual
