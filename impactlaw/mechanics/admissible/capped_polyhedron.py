"""A polyhedron cut by a ball whose sphere passes through the origin: nearest, extreme and farthest points."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb, sqrt

import numpy as np

from impactlaw.errors import SolverError
from impactlaw.mechanics.admissible.cone import EnumerationError
from impactlaw.mechanics.bilateral import Bilateral
from impactlaw.mechanics.tolerances import NEAR, SET_RANK, SET_ROUNDING, TIGHT, VANISHING
from impactlaw.solvers import nonnegative_combination
from impactlaw.solvers.least_squares import row_span

MAX_FACES = 100_000
"""Most sets of active constraints that `CappedPolyhedron.farthest` examines."""
_TRIES = 200


@dataclass(frozen=True, eq=False)
class CappedPolyhedron:
    """The set ``{x in R^r : A x >= b, |x - center| <= |center|}``, scaled to a size of about one.

    Methods raise `SolverError` if their iteration does not converge.
    """

    normals: np.ndarray  # ``A``, unit rows, shape (m, r)
    offsets: np.ndarray  # ``b``, shape (m,)
    center: np.ndarray  # of the ball, shape (r,)
    inside: np.ndarray  # a point of the polyhedron in the interior of the ball, shape (r,)

    def excess(self, x: np.ndarray) -> np.ndarray:
        """Return ``|x - center|^2 - |center|^2``, negative in the ball, for one point (r,) or several (n, r)."""
        return np.einsum("...i,...i", x, x - 2.0 * self.center)

    def has(self, x: np.ndarray, tol: float = 0.0) -> np.ndarray:
        """Whether one point (r,) or each of several (n, r) satisfies every constraint up to ``tol``."""
        allowed = 2.0 * tol * np.linalg.norm(self.center)
        return (self.excess(x) <= allowed) & (x @ self.normals.T >= self.offsets - tol).all(axis=-1)

    def nearest(self, y: np.ndarray) -> np.ndarray:
        """Return the point of the set nearest to y, shape (r,).

        With the ball's multiplier ``beta >= 0``, ``y - x + beta (center - x)`` is normal to the polyhedron at x. So x
        is the polyhedron's point nearest to ``(y + beta center) / (1 + beta)``, between y and the center.
        """
        if self.has(y):
            return y
        ray = y - self.center
        length = float(np.linalg.norm(ray))
        ray /= max(length, SET_ROUNDING)
        if length <= np.linalg.norm(y):
            return self._last_in_ball(self.center, ray, 0.0, length)
        return self._last_in_ball(y, ray, -length, 0.0)

    def extreme(self, direction: np.ndarray) -> np.ndarray:
        """Return a point x of the set with the largest ``direction^T x``, shape (r,); direction has length one.

        As in `nearest`, x is the polyhedron's point nearest to ``center + direction / beta``; the limit ``beta = 0``
        gives a maximiser over the whole polyhedron.
        """
        return self._last_in_ball(self.center, direction, 0.0, np.inf)

    def farthest(self) -> np.ndarray:
        """Return a point of the set farthest from the origin, (r,); `EnumerationError` if it has too many faces.

        ``|x|^2`` is convex, so the point is a vertex, or on the sphere. On the sphere ``|x|^2 = 2 center^T x`` is
        linear, with two stationary points per face, unless it is constant on the face; then any point will do.
        """
        r, met, count = len(self.center), [], 0
        for i, normal in enumerate(self.normals):
            if normal @ self.extreme(-normal) <= self.offsets[i] + NEAR:
                met.append(i)
                count = sum(comb(len(met), k) for k in range(r + 1))
            if count > MAX_FACES:
                raise EnumerationError(f"the farthest point of a set in {r} dimensions with more than {count} faces")
        best, sizes = self.inside, range(1, min(r, len(met)) + 1)
        points = np.vstack([2.0 * self.center, *(self._stationary(np.array([*combinations(met, k)])) for k in sizes)])
        points = points[self.has(points, NEAR)]
        for x in points[np.argsort(-np.linalg.norm(points, axis=1))]:
            if np.linalg.norm(x) <= (1.0 + TIGHT) * np.linalg.norm(best):
                break
            best = max(best, self.nearest(x), key=np.linalg.norm)
        return best

    def _stationary(self, rows: np.ndarray) -> np.ndarray:
        """Return for each flat ``A[rows] x = b[rows]`` its point nearest to 0 and the extremes of |x| on the sphere."""
        A, b = self.normals[rows], self.offsets[rows]
        inverse = np.linalg.pinv(A, rcond=SET_RANK)

        def within(v: np.ndarray) -> np.ndarray:
            return v - np.einsum("nij,nj->ni", inverse, A @ v)

        foot = np.einsum("nij,nj->ni", inverse, b)
        along = within(self.center)
        reach = np.linalg.norm(along, axis=1)
        constant = reach <= TIGHT * np.linalg.norm(self.center)
        along[constant] = within(np.cos(np.arange(1.0, 1.0 + len(self.center))))[constant]
        reach[constant] = 0.0
        length = np.linalg.norm(along, axis=1, keepdims=True)
        along = np.divide(along, length, out=np.zeros_like(along), where=length > TIGHT)
        # foot + s along is on the sphere if s^2 - 2 reach s = depth
        depth = -self.excess(foot)
        s = reach + np.sqrt(np.maximum(reach**2 + depth, 0.0))
        other = -np.divide(depth, s, out=np.zeros_like(s), where=s > 0)
        return np.vstack([foot, foot + s[:, None] * along, foot + other[:, None] * along])

    def _last_in_ball(self, base: np.ndarray, ray: np.ndarray, low: float, high: float) -> np.ndarray:
        """Return the polyhedron's point nearest to ``base + t ray``, for the last t in [low, high] with it in the ball.

        As t grows the point moves away from the center, on a straight line until its active constraints change. Each
        straight piece predicts where the point leaves the ball; bisection is used if the piece ends before.
        """
        unit = 1.0 + float(np.linalg.norm(self.center))
        best, last = self.inside, high
        t = high if np.isfinite(high) else unit
        for step in range(_TRIES):
            x, along = self._on_polyhedron(base, t, ray, best)
            excess = float(self.excess(x))
            if excess <= SET_ROUNDING * unit:
                best, low = x, t
                if excess >= -SET_ROUNDING * unit or t == last:
                    return x
                if np.isinf(high) and np.linalg.norm(self._pushing(x, ray)[1]) <= TIGHT:
                    return x  # no point of the polyhedron is farther along the ray
            else:
                high = t
            if high - low <= SET_ROUNDING * max(1.0, abs(low), abs(t)) or low > unit / SET_ROUNDING:
                return best
            speed = float((x - self.center) @ along)
            root = sqrt(max(speed**2 - excess * float(along @ along), 0.0))
            t = t - excess / (speed + root) if speed + root > 0 else high
            if not low < t < high or step % 3 == 2:
                t = 0.5 * (low + high) if np.isfinite(high) else 16.0 * max(low, unit)
        raise SolverError(f"the multiplier of the energy was not found in {_TRIES} steps, between {low} and {high}")

    def _on_polyhedron(
        self, base: np.ndarray, t: float, ray: np.ndarray, start: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the polyhedron's point x nearest to ``y = base + t ray``, and its derivative with respect to t.

        This is a primal active set method from a feasible start. The projection of y - x onto the tangent cone at x
        decides which tight constraints stay active, so that degenerate corners do no harm. Then x moves towards the
        point nearest to y on the flat of the active constraints, and each constraint that it meets becomes active. The
        iteration ends when x gets no nearer to y.
        """
        A, b, x = self.normals, self.offsets, start
        for _ in range(20 * sum(A.shape)):
            active = self._pushing(x, base + t * ray - x)[0]
            before = x
            while True:
                kept = Bilateral(*row_span(A[active], SET_RANK))
                along, towards = kept.project(np.stack([ray, base - x]))
                move = towards + t * along
                rate = A @ move
                meets = rate < -VANISHING * np.linalg.norm(move)
                meets[active] = False
                room = np.maximum(A @ x - b, 0.0)
                steps = np.divide(room, -rate, out=np.ones_like(rate), where=meets)
                first = int(np.argmin(steps))
                step = min(1.0, steps[first])
                x = x + step * move
                x = x + kept.combination @ (b[active] - A[active] @ x) @ kept.basis
                if step == 1.0:
                    break
                active = np.append(active, first)
            moved, middle = x - before, 0.5 * (x + before)
            gain = moved @ (base - middle) + t * (moved @ ray)
            size = 1.0 + np.linalg.norm(x) + np.linalg.norm(base) + abs(t) * along.any()
            length = np.linalg.norm(moved)
            if length <= SET_ROUNDING * (1.0 + np.linalg.norm(x)) or gain <= 4.0 * SET_ROUNDING * size * length:
                return x, along
        raise SolverError(f"the nearest point was not found on {len(b)} constraints")

    def _pushing(self, x: np.ndarray, pull: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the tight constraints that hold x against the pull, and the part of the pull that remains."""
        tight = np.flatnonzero(self.normals @ x - self.offsets <= TIGHT)
        push = nonnegative_combination(self.normals[tight], -pull, shared=False)
        return tight[push > 0], pull + push @ self.normals[tight]
