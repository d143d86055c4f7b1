"""Solve one contact with exact friction: open, sticking, or sliding in a direction found from a scalar equation."""

from __future__ import annotations

from math import atan2, cos, hypot, sin

import numpy as np
import scipy

from impactlaw.solvers.friction.problem import ConeProblem

STEEP = 0.9  # largest |G_nt| relative to G_nn: above, sliding itself may press a contact closed
SINGULAR = 1e-12  # pivot, relative to the diagonal entry of G, that counts as zero
_STEPS = 20  # largest number of Newton steps
_TURN = 1e-15  # change of the angle at which the iteration ends, rad
_LONGEST = 0.5  # largest change of the angle in one step, rad


def single(problem: ConeProblem, guess: np.ndarray | None) -> np.ndarray | None:
    """Return the scaled impulse, (1, m), of a problem of one contact with up to two directions of sliding.

    A contact that slides along the unit vector d has ``Lambda_t = -Lambda_n d`` and ``u_n = 0``, hence
    ``Lambda_n = -b_n / D`` with ``D = G_nn - G_nt d``, and d is the direction of
    ``D u_t = D b_t - b_n (G_tn - G_tt d)``.

    Returns:
        The impulse; None if G is singular, if friction is so large that there may be several solutions, or if no
        solution is found.
    """
    m = problem.shape[1]
    G, b = problem.delassus.tolist(), problem.start[0].tolist()
    if b[0] >= 0.0:
        return np.zeros(problem.shape)
    if m > 3 or not G[0][0] > 0.0 or hypot(*G[0][1:]) > STEEP * G[0][0]:
        return None
    if m == 1:
        return np.array([[-b[0] / G[0][0]]])
    factor, stuck, failed = scipy.linalg.lapack.dposv(problem.delassus, -problem.start[0])
    independent = not failed and (factor.diagonal() ** 2 > SINGULAR * problem.delassus.diagonal()).all()
    if independent and hypot(*stuck[1:]) <= stuck[0]:
        return stuck[None]
    if m == 2:
        return _along_a_line(G, b)
    return _in_a_plane(G, b, b if guess is None or not np.count_nonzero(guess[1:]) else (-guess).tolist())


def _along_a_line(G: list[list[float]], b: list[float]) -> np.ndarray | None:
    for d in (1.0, -1.0):
        D = G[0][0] - G[0][1] * d
        if d * (D * b[1] - b[0] * (G[0][1] - G[1][1] * d)) >= 0.0:
            pressing = -b[0] / D
            return np.array([[pressing, -pressing * d]])
    return None


def _in_a_plane(G: list[list[float]], b: list[float], sliding: list[float]) -> np.ndarray | None:
    """Find d by Newton's method for the angle at which ``D u_t`` is along d, starting at that of a sliding velocity."""
    (normal, p, q), (_, r, s), (_, _, t) = G
    pressed, x, y = b
    angle = atan2(sliding[2], sliding[1])
    for _ in range(_STEPS):
        c, d = cos(angle), sin(angle)
        D, turn = normal - p * c - q * d, p * d - q * c  # and dD / d angle
        ux = D * x - pressed * (p - r * c - s * d)
        uy = D * y - pressed * (q - s * c - t * d)
        along = ux * c + uy * d
        if along <= 0.0:  # friction would push along the sliding velocity
            angle = atan2(uy, ux)
            continue
        slope = along + (turn * x + pressed * (s * c - r * d)) * d - (turn * y + pressed * (t * c - s * d)) * c
        if slope == 0.0:
            return None
        step = (uy * c - ux * d) / slope
        step = min(max(step, -_LONGEST), _LONGEST)
        angle += step
        if abs(step) <= _TURN * max(abs(angle), 1.0):
            c, d = cos(angle), sin(angle)
            pressing = -pressed / (normal - p * c - q * d)
            return np.array([[pressing, -pressing * c, -pressing * d]])
    return None
