"""Treat tiny gaps of bodies at rest as closed, since closing them would keep the bodies in motion.

In piles, MuJoCo's contact points jump from step to step, and gaps of 1e-7 m come and go with them.
"""

from __future__ import annotations

from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import clear, plain

TOUCHING = 1e-6
"""Gap, m or rad, up to which bodies at rest touch; contact points in piles jump by more from step to step."""
ROUNDED = 1e-6  # part of it up to which a gap is due to rounding, and closed whether its bodies are at rest or not
_RESTING = 1e-2
"""Kinetic energy up to which bodies are at rest, relative to the energy that forces add to rest within a step."""


@plain
def _write_energies(before, free, inertia, tree, now, added):
    """Write ``v^T M_h v`` of each tree of bodies at the start, and the same for the velocity that forces add."""
    clear(now)
    clear(added)
    for i in range(len(before)):
        v, change = before[i], free[i] - before[i]
        for a in range(inertia.adr[i], inertia.adr[i] + inertia.nnz[i] - 1):
            k = inertia.col[a]
            v += inertia.factor[a] * before[k]
            change += inertia.factor[a] * (free[k] - before[k])
        now[tree[i]] += v * v / inertia.inverse[i]
        added[tree[i]] += change * change / inertia.inverse[i]


@plain
def close_tiny_gaps(rows, before, free, inertia, tree, touching, now, added):
    """Set to 0 the gaps, up to `touching`, of contacts and limits of bodies at rest.

    A tree of bodies is at rest if ``v^T M_h v < 0.01 w^T M_h w``, where w is what forces add to the velocity v in the
    step without contact.

    Args:
        rows: see `rows.Rows`; gaps are written.
        before: v, at the start of the step, (nv,).
        free: v + w, (nv,).
        inertia: the mass matrix ``M_h`` of the step.
        tree: tree of each degree of freedom, (nv,).
        touching: largest gap that is closed, m or rad.
        now: scratch space, at least (ntree,).
        added: scratch space, at least (ntree,).
    """
    known = False
    for g in range(len(rows.key)):
        if rows.groups[2, g] != CONE or not 0.0 < rows.amounts[0, g] <= touching:
            continue
        if rows.amounts[0, g] <= ROUNDED * touching:
            rows.amounts[0, g] = 0.0
            continue
        if not known:
            _write_energies(before, free, inertia, tree, now, added)
            known = True
        row, rests = rows.groups[0, g], True
        for a in range(rows.sparse[1, row], rows.sparse[1, row] + rows.sparse[0, row]):
            t = tree[rows.colind[a]]
            rests = rests and now[t] < _RESTING * added[t]
        if rests:
            rows.amounts[0, g] = 0.0
