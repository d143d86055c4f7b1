"""A polyhedron cut by a ball whose sphere passes through the origin: nearest, extreme and farthest points."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from impactlaw.cone import EnumerationError, nearest_in_cone
from impactlaw.errors import SolverError

MAX_FACES = 100_000
"""Most sets of constraints that `CappedPolyhedron.farthest` looks at."""
_ROUNDING = 1e-15
_ON = 1e-11  # slack, or part of a unit vector, that counts as zero
_RANK = 1e-10  # relative singular value below which constraints count as dependent
_OPTIMAL = 1e-13
_ROUNDING_SLACK = 1e-11
_STEPS = 200
_NEAR = 1e-9


@dataclass(frozen=True, eq=False)
class CappedPolyhedron:
    """``{x in R^r : A x >= b, |x - center| <= |center|}``, of size about one.

    Attributes:
        normals: ``A``, unit rows, shape (m, r).
        offsets: ``b``, shape (m,).
        center: of the ball, shape (r,).
        inside: a point of the polyhedron in the interior of the ball, shape (r,).
    """

    normals: np.ndarray
    offsets: np.ndarray
    center: np.ndarray
    inside: np.ndarray

    def excess(self, x: np.ndarray) -> np.ndarray:
        """Return ``|x - center|^2 - |center|^2``, negative in the ball, for one point (r,) or several (n, r)."""
        return np.einsum("...i,...i", x, x - 2.0 * self.center)

    def has(self, x: np.ndarray, tol: float = 0.0) -> np.ndarray:
        """Whether one point (r,) or several (n, r) keep every constraint up to ``tol``."""
        allowed = 2.0 * tol * np.linalg.norm(self.center)
        return (self.excess(x) <= allowed) & (x @ self.normals.T >= self.offsets - tol).all(axis=-1)

    def nearest(self, y: np.ndarray) -> np.ndarray:
        """Return the point of the set nearest to y, shape (r,).

        With the ball's multiplier ``beta >= 0``, ``y - x + beta (center - x)`` is normal to the polyhedron at x: then x
        is the polyhedron's point nearest to ``(y + beta center) / (1 + beta)``, which lies between y and the center.
        """
        if self.has(y):
            return y
        ray = y - self.center
        length = float(np.linalg.norm(ray))
        ray /= max(length, _ROUNDING)
        if length <= np.linalg.norm(y):
            return self._last_in_ball(self.center, ray, 0.0, length)
        return self._last_in_ball(y, ray, -length, 0.0)

    def extreme(self, direction: np.ndarray) -> np.ndarray:
        """Return a point x of the set with the largest ``direction^T x``, shape (r,); direction has length one.

        With the ball's multiplier ``beta > 0``, ``direction - beta (x - center)`` is normal to the polyhedron at x: then
        x is the polyhedron's point nearest to ``center + direction / beta``. The limit ``beta = 0`` gives a maximiser
        over the whole polyhedron.
        """
        return self._last_in_ball(self.center, direction, 0.0, np.inf)

    def farthest(self) -> np.ndarray:
        """Return a point of the set farthest from the origin, shape (r,), by looking at every face.

        ``|x|^2`` is convex, so the point is a vertex, or on the sphere, where ``|x|^2 = 2 center^T x`` is linear and has
        two stationary points per face (or is constant, and then any point on the sphere will do).

        Raises:
            EnumerationError: more than `MAX_FACES` sets of constraints.
        """
        used = [i for i, (n, b) in enumerate(zip(self.normals, self.offsets)) if n @ self.extreme(-n) <= b + _NEAR]
        m, r = len(used), len(self.center)
        if sum(comb(m, k) for k in range(r + 1)) > MAX_FACES:
            raise EnumerationError(f"{m} constraints in {r} dimensions have too many faces to look at each")
        flats = (np.array(list(combinations(used, k)), dtype=int).reshape(comb(m, k), k) for k in range(r + 1))
        points = np.vstack([self._stationary(rows) for rows in flats])
        points = points[self.has(points, _NEAR)]
        best = self.inside
        for x in points[np.argsort(-np.linalg.norm(points, axis=1))]:
            if np.linalg.norm(x) <= (1.0 + _ON) * np.linalg.norm(best):
                break
            best = max(best, self.nearest(x), key=np.linalg.norm)
        return best

    def _stationary(self, rows: np.ndarray) -> np.ndarray:
        """On the flats ``A[rows] x = b[rows]``: the point nearest to 0, and the extremes of ``center^T x`` on the sphere."""
        A, b = self.normals[rows], self.offsets[rows]
        inverse = np.linalg.pinv(A, rcond=_RANK)

        def within(v: np.ndarray) -> np.ndarray:
            return v - np.einsum("nij,nj->ni", inverse, A @ v)

        foot = np.einsum("nij,nj->ni", inverse, b)
        along = within(self.center)
        reach = np.linalg.norm(along, axis=1)
        constant = reach <= _ON * np.linalg.norm(self.center)
        along[constant] = within(np.cos(np.arange(1.0, 1.0 + len(self.center))))[constant]
        reach[constant] = 0.0
        length = np.linalg.norm(along, axis=1)
        along = np.divide(along, length[:, None], out=np.zeros_like(along), where=length[:, None] > _ON)
        # foot + s along is on the sphere where s^2 - 2 reach s = depth
        depth = -self.excess(foot)
        s = reach + np.sqrt(np.maximum(reach**2 + depth, 0.0))
        other = -np.divide(depth, s, out=np.zeros_like(s), where=s > 0)
        return np.vstack([foot, foot + s[:, None] * along, foot + other[:, None] * along])

    def _last_in_ball(self, base: np.ndarray, ray: np.ndarray, low: float, high: float) -> np.ndarray:
        """Return the polyhedron's point nearest to ``base + t ray``, for the last t in [low, high] with it in the ball.

        As t grows the point moves away from the center, straight until its active constraints change. Each straight
        piece says where it would leave the ball; bisection takes over when it ends before.
        """
        unit = 1.0 + float(np.linalg.norm(self.center))
        best, last = self.inside, high
        t = high if np.isfinite(high) else unit
        for step in range(_STEPS):
            x, along = self._on_polyhedron(base, t, ray, best)
            excess = float(self.excess(x))
            if excess <= _ROUNDING * unit:
                best, low = x, t
                if excess >= -_ROUNDING * unit or t == last or (np.isinf(high) and self._is_last(x, ray)):
                    return x
            else:
                high = t
            if high - low <= _ROUNDING * max(1.0, abs(low), abs(t)) or low > unit / _ROUNDING:
                return best
            speed = (x - self.center) @ along
            root = np.sqrt(max(speed**2 - excess * (along @ along), 0.0))
            t = t - excess / (speed + root) if speed + root > 0 else high
            if not low < t < high or step % 3 == 2:
                t = 0.5 * (low + high) if np.isfinite(high) else 16.0 * max(low, unit)
        raise SolverError(f"no multiplier of the energy in {_STEPS} steps, between {low} and {high}")

    def _on_polyhedron(
        self, base: np.ndarray, t: float, ray: np.ndarray, start: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the polyhedron's point x nearest to ``y = base + t ray``, and its derivative by t.

        A primal active set from a feasible start: y - x projected onto the tangent cone at x (NNLS, so degenerate
        corners do no harm) tells which tight constraints to keep, then x goes towards the nearest point on their
        flat, and keeps each constraint that it meets.
        """
        A, b, x = self.normals, self.offsets, start
        for _ in range(20 * sum(A.shape)):
            active = self._pushing(x, base + t * ray - x)[0]
            before, step = x, 0.0
            while step < 1.0:
                flat = _Flat(A[active], b[active])
                along = flat.within(ray)
                move = flat.within(base - x) + t * along
                rate = A @ move
                meets = rate < -_OPTIMAL * np.linalg.norm(move)
                meets[active] = False
                room = np.maximum(A @ x - b, 0.0)
                steps = np.divide(room, -rate, out=np.ones_like(rate), where=meets)
                first = int(np.argmin(steps))
                step = min(1.0, steps[first])
                x = flat.onto(x + step * move)
                active = np.append(active, first)
            moved, middle = x - before, 0.5 * (x + before)
            gain = moved @ (base - middle) + t * (moved @ ray)
            size = 1.0 + np.linalg.norm(x) + np.linalg.norm(base) + abs(t) * along.any()
            length = np.linalg.norm(moved)
            if length <= _ROUNDING * (1.0 + np.linalg.norm(x)) or gain <= 4.0 * _ROUNDING * size * length:
                return x, along
        raise SolverError(f"no nearest point found on {len(b)} constraints")

    def _pushing(self, x: np.ndarray, pull: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the constraints that hold x against the pull, and the part of the pull that they leave."""
        tight = np.flatnonzero(self.normals @ x - self.offsets <= _ROUNDING_SLACK)
        push = nearest_in_cone(self.normals[tight], -pull)
        return tight[push > 0], pull + push @ self.normals[tight]

    def _is_last(self, x: np.ndarray, ray: np.ndarray) -> bool:
        """Whether no point of the polyhedron is farther along the ray than x."""
        return bool(np.linalg.norm(self._pushing(x, ray)[1]) <= _ON)


class _Flat:
    """``{x : A x = b}`` for unit rows A."""

    def __init__(self, A: np.ndarray, b: np.ndarray):
        U, s, V = np.linalg.svd(A, full_matrices=False)
        keep = s > _RANK * s.max(initial=0.0)
        self.A, self.b, self.rows = A, b, V[keep]
        self.inverse = V[keep].T @ (U[:, keep] / s[keep]).T

    def onto(self, x: np.ndarray) -> np.ndarray:
        return x + self.inverse @ (self.b - self.A @ x)

    def within(self, v: np.ndarray) -> np.ndarray:
        w = v - (v @ self.rows.T) @ self.rows
        w -= (w @ self.rows.T) @ self.rows
        return np.where(np.linalg.norm(w) > _OPTIMAL * np.linalg.norm(v), w, 0.0)
