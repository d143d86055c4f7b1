"""Contacts of bodies at rest: a tiny gap is none, for to close it would keep them in motion.

In piles MuJoCo's points of contact jump from step to step, and gaps of 1e-7 m come and go with them.
"""

from __future__ import annotations

from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import clear, plain

TOUCHING = 1e-6
"""Gap, m or rad, up to which bodies at rest touch: in piles, points of contact jump by more from step to step."""
_RESTING = 1e-2
"""Kinetic energy up to which bodies are at rest, as a part of what forces make of rest within a step."""


@plain
def _write_energies(before, free, factor, Mnnz, Madr, Mcol, inverse, tree, now, added):
    """Write ``v^T M_h v`` of each tree of bodies at the start, and of what forces add without contact."""
    clear(now)
    clear(added)
    for i in range(len(before)):
        v, change = before[i], free[i] - before[i]
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            v += factor[a] * before[Mcol[a]]
            change += factor[a] * (free[Mcol[a]] - before[Mcol[a]])
        now[tree[i]] += v * v / inverse[i]
        added[tree[i]] += change * change / inverse[i]


@plain
def close_tiny_gaps(rows, before, free, factor, Mnnz, Madr, Mcol, inverse, tree, touching, now, added):
    """Let contacts and limits of bodies at rest touch, gap 0, whose gap is up to `touching`.

    A tree of bodies is at rest where ``v^T M_h v < 0.01 w^T M_h w``, w what forces add to the velocity v in the step
    without contact.

    Args:
        rows: see `rows.Rows`; gaps are written.
        before: v, at the start of the step, (nv,).
        free: v + w, (nv,).
        factor: L of ``M_h = L^T D L``, like the four that follow in MuJoCo's layout.
        Mnnz: entries of each row of M.
        Madr: where they begin.
        Mcol: their columns, the diagonal last.
        inverse: ``1 / D``, (nv,).
        tree: of each degree of freedom, (nv,).
        touching: m or rad.
        now: room, (ntree,) at least.
        added: the same.
    """
    known = False
    for g in range(len(rows.key)):
        if rows.groups[2, g] != CONE or not 0.0 < rows.amounts[0, g] <= touching:
            continue
        if not known:
            _write_energies(before, free, factor, Mnnz, Madr, Mcol, inverse, tree, now, added)
            known = True
        row, rests = rows.groups[0, g], True
        for a in range(rows.sparse[1, row], rows.sparse[1, row] + rows.sparse[0, row]):
            t = tree[rows.colind[a]]
            rests = rests and now[t] < _RESTING * added[t]
        if rests:
            rows.amounts[0, g] = 0.0
