"""Semismooth Newton steps on the complementarity of contacts with friction."""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from impactlaw import deferred
from impactlaw.solvers.friction.problem import ENOUGH, SHARP, ConeProblem, project, projection_derivative

_TINY = 1e-300
_LEAST = 1e-6  # of the diagonal of G, at most 1, that a step of the map is made of
_HALVINGS = 5
_COMPLIANCES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
_STEPS = 15
_RANK = 1e-9  # relative singular value of the derivative below which contacts are redundant
SHARED = 1e-12
"""Relative residual that sharing may cost."""


class Point(NamedTuple):
    """Where an iteration stands.

    Attributes:
        x: scaled impulse, (h, m).
        u: scaled velocity of the complementarity, (h, m).
        value: the map that Newton's method makes zero, (h, m).
        merit: its length.
        parts: what the derivative is made of.
    """

    x: np.ndarray
    u: np.ndarray
    value: np.ndarray
    merit: float
    parts: tuple[np.ndarray, ...]


class NewtonMap:
    """A map of impulse and velocity that is zero where the complementarity holds, and its generalized derivative.

    For exact friction it is that of P. Alart and A. Curnier (Comput. Methods Appl. Mech. Eng. 92, 1991), with
    ``p = x_n - r_n u_n`` and ``q = x_t - r_t u_t``, ``F_n = x_n - [p]+`` and ``F_t = x_t - (q`` cut to length
    ``[p]+)``; for the convex relaxation the natural map.

    Args:
        problem: what to solve.
        compliance: c >= 0 of ``u = (G + c) x + b``; 0 is the problem itself.
        factor: of ``r_n = 1 / G_nn`` and of ``r_t``, 1 over the largest of G_tt.
    """

    def __init__(self, problem: ConeProblem, compliance: float = 0.0, factor: float = 1.0):
        h, m = problem.shape
        self.problem, self.compliance = problem, compliance
        diagonal = np.maximum(problem.delassus.diagonal().reshape(h, m), _LEAST)
        self.each = factor / diagonal.max(axis=1, keepdims=True)
        self.steps = np.repeat(factor / diagonal[:, 1:].max(axis=1, initial=_LEAST, keepdims=True), m, axis=1)
        self.steps[:, 0] = factor / diagonal[:, 0]

    def at(self, x: np.ndarray) -> Point:
        """Evaluate the map."""
        u = self.problem.velocity(x)
        if self.compliance:
            u += self.compliance * x
        value, *parts = self._exact(x, u) if self.problem.exact else self._convex(x, u)
        flat = value.reshape(-1)
        merit = sqrt(flat.dot(flat))
        return Point(x, u, value, merit if merit >= 0 else inf, tuple(parts))

    def derivative(self, point: Point, regular: float) -> np.ndarray:
        """Return ``P + Q (G + regular)``, (h m, h m)."""
        h, m = self.problem.shape
        n = h * m
        P, Q = self._exact_parts(*point.parts) if self.problem.exact else self._convex_parts(*point.parts)
        G = self.problem.delassus.copy()
        G.reshape(-1)[:: n + 1] += regular + self.compliance
        system = np.matmul(Q, G.reshape(h, m, n)).reshape(h, m, h, m)
        i = np.arange(h)
        system[i, :, i, :] += P
        return system.reshape(n, n)

    def step(self, point: Point, regular: float) -> np.ndarray:
        """Return Newton's step, (h, m), with ``G + regular`` in place of a G that may be singular."""
        system, value = self.derivative(point, regular), point.value.reshape(-1)
        _, _, step, failed = deferred.dgesv(system, value)
        if failed:
            step = deferred.lstsq(system, value)[0]
        return -step.reshape(point.x.shape)

    def _exact(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, ...]:
        y = x - self.steps * u
        p, q = y[:, 0], y[:, 1:]
        N = np.maximum(p, 0.0)
        r = np.sqrt(np.vecdot(q, q))
        cut = N / np.maximum(np.maximum(r, N), _TINY)
        value = x.copy()
        value[:, 0] -= N
        value[:, 1:] -= cut[:, None] * q
        return value, N, q, r, cut

    def _exact_parts(
        self, N: np.ndarray, q: np.ndarray, r: np.ndarray, cut: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return P and Q, (h, m, m), of the derivative ``P + Q G``: ``P = 1 - D``, and ``Q = D`` times the steps."""
        h, m = self.problem.shape
        pressed = N > 0
        direction = np.where(r > N, 1.0 / np.maximum(r, _TINY), 0.0)[:, None] * q  # zero where it sticks
        D = np.zeros((h, m, m))
        D[:, 0, 0] = pressed
        D[:, 1:, 0] = direction * pressed[:, None]
        D[:, 1:, 1:] = cut[:, None, None] * (np.eye(m - 1) - direction[:, :, None] * direction[:, None, :])
        return np.eye(m) - D, D * self.steps[:, None, :]

    def _convex(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y = x - self.each * u
        return x - project(y), y

    def _convex_parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        D = projection_derivative(y)
        return np.eye(y.shape[1]) - D, self.each[:, None] * D


def newton(
    problem: ConeProblem, x: np.ndarray, *, most: int, regular: float = 1e-12, factor: float = 1.0
) -> tuple[np.ndarray, float, int]:
    """Return the best impulse found from x, its residual, and the number of steps.

    Args:
        problem: what to solve.
        x: scaled impulse to start from, (h, m).
        most: steps.
        regular: see `NewtonMap.step`.
        factor: see `NewtonMap`.
    """
    this = NewtonMap(problem, factor=factor)
    point = this.at(x)
    best, least = x, problem.residual(x, point.u)
    taken = 0
    while taken < most and least > SHARP * problem.scale:
        point = _search(this, point, this.step(point, regular))
        taken += 1
        residual = problem.residual(point.x, point.u)
        done = least <= ENOUGH * problem.scale and residual > 0.1 * least
        if residual < least:
            best, least = point.x, residual
        if done:
            break
    return best, least, taken


def continuation(problem: ConeProblem) -> tuple[np.ndarray, int]:
    """Follow the solution of compliant contacts, ``u = (G + c) x + b``, from large c to small; return x and steps."""
    x, taken = np.zeros(problem.shape), 0
    for c in _COMPLIANCES:
        this = NewtonMap(problem, c)
        point = best = this.at(x)
        for _ in range(_STEPS):
            if best.merit <= 1e-9 * problem.scale:
                break
            point = _search(this, point, this.step(point, 1e-12))
            taken += 1
            if point.merit < best.merit:
                best = point
        x = best.x
    return x, taken


def _search(this: NewtonMap, point: Point, step: np.ndarray) -> Point:
    """Return the first point along a step where the map is smaller; the whole step where none is."""
    whole = following = this.at(point.x + step)
    fraction = 1.0
    for _ in range(_HALVINGS):
        if following.merit <= (1.0 - 1e-4 * fraction) * point.merit:
            return following
        fraction *= 0.5
        following = this.at(point.x + fraction * step)
    return whole


def share(problem: ConeProblem, x: np.ndarray, residual: float) -> np.ndarray:
    """Return the least impulse, scaled, that solves the problem with what sticks, slides or is open as with x.

    Redundant contacts then share alike. It is x itself if that one leaves the cones.
    """
    this = NewtonMap(problem)
    point = this.at(x)
    system = this.derivative(point, 0.0)
    wanted = system.dot(x.reshape(-1)) - point.value.reshape(-1)
    least = deferred.lstsq(system, wanted, cond=_RANK)[0].reshape(x.shape)
    reached = problem.residual(least, problem.velocity(least))
    return least if reached <= max(10.0 * residual, SHARED * problem.scale) else x
