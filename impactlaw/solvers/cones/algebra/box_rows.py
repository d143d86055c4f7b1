"""Boxes ``|x| <= beta`` in an interior point method: each has two pairs of a slack and a complementary velocity.

``u = l - q`` with ``0 <= l  ⊥  x + beta >= 0`` and ``0 <= q  ⊥  beta - x >= 0``: dry friction at its bound opposes the
velocity. Let ``d = l / (x + beta) + q / (beta - x)``. A step that changes the products of the pairs by r and s solves
the row ``(G + c + d) dx = r / (x + beta) - s / (beta - x) - (u - l + q)``.
"""

import numpy as np

from impactlaw.solvers.cones.algebra.loops import Array, plain
from impactlaw.solvers.cones.algebra.structure import BOX, Island

_FIRST_SLACK = 0.5  # largest slack at the start, as a part of the bound


@plain
def begin_boxes(
    P: Island, guess: Array, v: Array, inside: float, near: bool, x: Array, low: Array, high: Array
) -> None:
    """Write impulses inside their bounds, near a guess or 0, and positive velocities l and q."""
    for g in range(len(P.kind)):
        if P.kind[g] == BOX:
            o, room = P.start[g], P.bound[g] - min(inside, _FIRST_SLACK * P.bound[g])
            x[o] = min(max(guess[o], -room), room) if near else 0.0
            low[o] = high[o] = inside
            if near:
                low[o] += max(v[o], 0.0)
                high[o] += max(-v[o], 0.0)


@plain
def box_weight(bound: float, c: float, x: float, low: float, high: float) -> float:
    """Return ``1 / (c + d)``; 0 if the bound is 0."""
    return 1.0 / (c + low / (x + bound) + high / (bound - x)) if bound > 0.0 else 0.0


@plain
def aim_boxes(P: Island, x, low, high, center: float, dx, dlow, dhigh, r, s) -> None:
    """Write the wanted changes r and s of the products of the pairs; dx, dlow, dhigh are the predictor step, or 0."""
    for g in range(len(P.kind)):
        if P.kind[g] == BOX:
            o = P.start[g]
            r[o] = center - low[o] * (x[o] + P.bound[g]) - dx[o] * dlow[o]
            s[o] = center - high[o] * (P.bound[g] - x[o]) + dx[o] * dhigh[o]


@plain
def box_push(bound: float, x: float, r: float, s: float) -> float:
    """Return ``r / (x + beta) - s / (beta - x)``."""
    return r / (x + bound) - s / (bound - x) if bound > 0.0 else 0.0


@plain
def follow_boxes(P: Island, x, low, high, r, s, dx, dlow, dhigh) -> None:
    """Write the changes of l and q in the step dx."""
    for g in range(len(P.kind)):
        if P.kind[g] == BOX and P.bound[g] > 0.0:
            o = P.start[g]
            dlow[o] = (r[o] - low[o] * dx[o]) / (x[o] + P.bound[g])
            dhigh[o] = (s[o] + high[o] * dx[o]) / (P.bound[g] - x[o])


@plain
def _until(value: float, change: float) -> float:
    return -value / change if change < 0.0 else np.inf


@plain
def box_reach(bound: float, x: float, low: float, high: float, dx: float, dlow: float, dhigh: float) -> float:
    """Return the fraction of a step in which slacks and velocities stay positive."""
    return min(min(_until(x + bound, dx), _until(bound - x, -dx)), min(_until(low, dlow), _until(high, dhigh)))


@plain
def box_gap(bound: float, x: float, low: float, high: float) -> float:
    """Return the sum of the products of both pairs."""
    return low * (x + bound) + high * (bound - x)
