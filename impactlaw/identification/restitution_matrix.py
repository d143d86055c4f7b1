"""The fit of a full restitution matrix to measured collisions, with a certificate that it creates no energy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw.errors import MeasurementError, SolverError, UnsolvableLawError
from impactlaw.identification.measurements import Measurements, rms
from impactlaw.laws.fremond import Fremond

_ACTIVE = 1e-9  # impulse, times the length of its gradient and relative to |v-|, that counts as 0
_RANK = 1e-9  # eigenvalue of the normal equations, relative to the largest one, that is rounding
_SAME = 1e-9  # relative difference of Delassus matrices that count as the same
_STEPS = 20_000
_DONE = 1e-15
_REFINEMENTS = 2
_ROUNDS = 30
_HALVINGS = 8
_SPLIT_STEPS, _SPLIT_DONE = 20_000, 1e-11


class Quadratic(NamedTuple):
    """The function ``x^T H x / 2 + g^T x``, where x are the entries of F, row by row."""

    H: np.ndarray
    g: np.ndarray


class MatrixFit:
    """The least-squares problem for E of one set of contacts, ``gamma+_A = -(E gamma-)_A`` where A carries impulses.

    Let A be the contacts with impulses in a collision. Apart from a part that E cannot change, its squared prediction
    error is ``(gamma+ + E gamma-)_A^T G_AA^-1 (gamma+ + E gamma-)_A / |v-|^2``, which is quadratic in E. The unknown is
    ``F = G^-1/2 E G^1/2``, with the mean G of the collisions. If ``|F|_2 <= 1``, E creates no energy.

    Args:
        measured: collisions of one set of contacts.
        order: indices that bring the contacts of each collision into a common order, (n, h).
    """

    def __init__(self, measured: Measurements, order: np.ndarray):
        self.measured, self.order, self.speeds = measured, order, measured.speeds
        cs = measured.collisions
        each = list(zip(cs, measured.post_velocities, order, strict=True))
        self.G = np.array([c.delassus[np.ix_(o, o)] for c, _, o in each])
        self.before = np.array([c.pre_contact_velocity[o] for c, _, o in each])
        self.after = np.array([c.contact_velocity_after(v)[o] for c, v, o in each])
        self.mean_G = self.G.mean(axis=0)
        w, V = np.linalg.eigh(self.mean_G)
        if w[0] <= 1e-10 * w[-1]:
            raise MeasurementError(
                f"contacts {', '.join(cs[0].labels)} depend on each other: many matrices E have the same outcome; "
                "leave the redundant contact out"
            )
        self.root, self.inverse_root = (V * np.sqrt(w)) @ V.T, (V / np.sqrt(w)) @ V.T

    def impulses(self) -> np.ndarray:
        """Return the observed impulses from ``gamma+ - gamma- = G Lambda``, scaled to units of ``|v-|``, (n, h)."""
        impulse = np.linalg.solve(self.G, (self.after - self.before)[..., None])[..., 0]
        lengths = np.sqrt(np.einsum("nii->ni", self.G))
        return impulse * lengths / self.speeds[:, None]

    def equations(self, active: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return D, (r, h^2), and e, (r,), of each collision, given which contacts carry impulses, bool (n, h).

        Its squared error is ``|D x + e|^2``, where x are the entries of F, row by row.
        """
        found = []
        each = zip(self.G, self.before @ self.inverse_root, self.after, self.speeds, active, strict=True)
        for G, before, after, speed, A in each:
            L = np.linalg.cholesky(G[np.ix_(A, A)])
            rows = np.linalg.solve(L, np.column_stack([self.root[A], after[A]])) / speed
            found.append((np.kron(rows[:, :-1], before), rows[:, -1]))
        return found

    def matrix(self, F: np.ndarray) -> np.ndarray:
        """Return ``E = G^1/2 F G^-1/2``."""
        return self.root @ F @ self.inverse_root

    def predicted(self, F: np.ndarray) -> tuple[np.ndarray, float]:
        """Return which contacts carry impulses under the law of F, bool (n, h), and the rms of its errors."""
        law = Fremond(self.matrix(F))
        active, errors = np.zeros(self.before.shape, dtype=bool), []
        for i, c in enumerate(self.measured.collisions):
            o = self.order[i]
            E = np.empty_like(law.matrix)
            E[np.ix_(o, o)] = law.matrix
            try:
                impact = Fremond(E).resolve(c)
            except (UnsolvableLawError, SolverError):
                return active, np.inf
            active[i] = (impact.impulse * c.gradient_norms)[o] > _ACTIVE * self.speeds[i]
            errors.append(self.measured.bases[i] @ (impact.whitened_jump - self.measured.jumps[i]) / self.speeds[i])
        return active, rms(errors)

    def bound(self, F: np.ndarray) -> float:
        """Return ``max |G^-1/2 E G^1/2|_2`` over the Delassus matrices of all collisions; above 1 E creates energy."""
        E = self.matrix(F)
        same = np.abs(self.G - self.mean_G).max() <= _SAME * np.abs(self.mean_G).max()
        L = np.linalg.cholesky(self.G[:1] if same else self.G)
        return float(np.linalg.norm(np.linalg.solve(L, E @ L), 2, axis=(1, 2)).max())

    def solve(self, *, admissible: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return the best F found, and which contacts carry impulses under it, bool (n, h).

        The first active sets are the contacts with observed impulses. Gauss-Newton steps then use the active sets that
        the law itself predicts, as long as the prediction improves.
        """
        active = self.impulses() > _ACTIVE
        F = self._best(active, admissible)
        own, error = self.predicted(F)
        for _ in range(_ROUNDS):
            if np.array_equal(own, active):
                break
            active, aim = own, self._best(own, admissible)
            for k in range(_HALVINGS):
                trial = F + 0.5**k * (aim - F)
                found, better = self.predicted(trial)
                if better < error:
                    break
            else:
                break
            F, own, error = trial, found, better
        return F, own

    def _best(self, active: np.ndarray, admissible: bool) -> np.ndarray:
        D, e = map(np.concatenate, zip(*self.equations(active), strict=True))
        q, h = Quadratic(D.T @ D, D.T @ e), len(self.root)
        if admissible:
            F = self._admissible(q)
        else:
            F = constrained(q, h)
            inverse = np.linalg.pinv(q.H, rcond=_RANK, hermitian=True)
            for _ in range(_REFINEMENTS):  # with residuals, which are more accurate than H and g
                if np.linalg.norm(F, 2) >= 1.0 - 1e-9:
                    break
                F = F - (inverse @ (D.T @ (D @ F.ravel() + e))).reshape(h, h)
        return F / max(1.0, self.bound(F))

    def _admissible(self, q: Quadratic) -> np.ndarray:
        """Return the minimum over ``|F| <= 1, E >= 0, G^-1 (1 + E) >= 0``, by ADMM."""
        h = len(self.root)
        to_E = np.kron(self.root, self.inverse_root.T)
        to_impulse = np.kron(np.linalg.inv(self.mean_G), np.eye(h)) @ to_E
        least = -np.linalg.inv(self.mean_G).ravel()
        scale = np.linalg.norm(to_impulse, 2)
        maps = np.vstack([np.eye(h * h), to_E, to_impulse / scale])
        weight = max(np.linalg.norm(q.H, 2), 1e-300) ** 0.5 * max(np.median(np.linalg.eigvalsh(q.H)), 1e-12) ** 0.5
        factor = np.linalg.inv(q.H + weight * maps.T @ maps)
        (z, u), x = np.zeros((2, 3 * h * h)), np.zeros(h * h)
        for _ in range(_SPLIT_STEPS):
            x = factor @ (weight * maps.T @ (z - u) - q.g)
            y = maps @ x + u
            for_F, for_E, for_impulse = np.split(y, 3)
            before, pushes = z, np.maximum(for_impulse, least / scale)
            z = np.concatenate([clipped(for_F.reshape(h, h)).ravel(), np.maximum(for_E, 0.0), pushes])
            u = y - z
            if max(np.abs(maps @ x - z).max(), np.abs(z - before).max()) < _SPLIT_DONE:
                break
        return clipped(x.reshape(h, h))


def clipped(F: np.ndarray) -> np.ndarray:
    """Return the nearest matrix with singular values of at most 1."""
    U, s, V = np.linalg.svd(F)
    return F if s[0] <= 1.0 else (U * np.minimum(s, 1.0)) @ V


def constrained(q: Quadratic, h: int) -> np.ndarray:
    """Return the minimum of least norm of ``x^T H x / 2 + g^T x`` over ``|F|_2 <= 1``, (h, h).

    If the unconstrained minimum violates the bound, it is found by projected gradient steps with Nesterov's
    acceleration, which is restarted when it goes uphill. The projection clips singular values.
    """
    w, V = np.linalg.eigh(q.H)
    large = w > _RANK * max(w[-1], 0.0)
    x = -V[:, large] @ ((V[:, large].T @ q.g) / w[large])
    F = x.reshape(h, h)
    if np.linalg.norm(F, 2) <= 1.0 or not large.any():
        return F
    step = 1.0 / w[-1]
    F = y = clipped(F)
    t = 1.0
    for _ in range(_STEPS):
        gradient = (q.H @ y.ravel() + q.g).reshape(h, h)
        new = clipped(y - step * gradient)
        change = new - F
        if np.abs(new - y).max() < _DONE:
            return new
        if np.sum((y - new) * change) > 0.0:  # uphill: restart
            t, y = 1.0, new
        else:
            t, last = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * t * t)), t
            y = new + (last - 1.0) / t * change
        F = new
    return F
