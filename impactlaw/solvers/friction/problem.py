"""The problem of contacts with friction: one Lorentz cone per contact, its natural map, and the form of an answer.

Rows are ordered contact by contact: first the normal row, then the tangential rows, multiplied by their coefficients of
friction. With tangential impulses divided by the same coefficients, the friction cone of a contact is
``K = {(a, y) : |y| <= a}``.
"""

from __future__ import annotations

from copy import copy
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from impactlaw.solvers.problem import Status

ENOUGH = 1e-10
"""Largest relative residual of an accepted answer."""
_TINY = 1e-300


class ConeAnswer(NamedTuple):
    """An impulse in the friction cones, with its velocity jump and its residual."""

    # ``Lambda``, shape (n,), in the units of the rows; tangential entries are divided by their coefficients
    impulse: np.ndarray
    jump: np.ndarray  # ``z = A^T Lambda``, shape (nv,), sqrt(J)
    residual: float  # length of the natural map, sqrt(J); see `ConeProblem.residual`
    status: Status  # "solved" if the residual is at most `ENOUGH` of the problem's scale, else "stopped"
    iterations: int  # total steps of all methods and attempts; 0 for the closed form


class ConeProblem:
    """Find ``Lambda`` with ``u = A A^T Lambda + b`` and one of two complementarity conditions for each contact.

    - exact Coulomb friction, after de Saxcé: ``K ∋ Lambda  ⊥  u + |u_t| e_n ∈ K``. The normal part is
      ``0 <= Lambda_n  ⊥  u_n >= 0``, and friction opposes sliding with the whole of ``Lambda_n``.
    - its convex relaxation, after Anitescu: ``K ∋ Lambda  ⊥  u ∈ K``, the optimality condition of
      ``min |A^T Lambda|^2 / 2 + b^T Lambda, Lambda ∈ K``. A contact that slides also separates, ``u_n = |u_t|``.

    `impactlaw.Coulomb` names the papers.

    Internally, contacts are padded with rows of zeros to a common size m, and the rows of contact i are divided by a
    length ``l_i``. This does not change the cones, and impulses and velocities are then in sqrt(J).

    Args:
        gradients: ``A``, rows in coordinates in which the kinetic metric is Euclidean, shape (n, nv).
        offset: ``b``, shape (n,).
        sizes: number of rows of each contact, 1 for a contact without friction, shape (h,), with sum n.
        exact: whether friction is exact Coulomb friction or its convex relaxation.
        speed: ``|v-|`` if known, sqrt(J).

    Attributes:
        largest: the largest ``|b_i| / l_i``, sqrt(J).
        scale: the larger of ``speed`` and ``largest``, sqrt(J), with which residuals are compared.
        lengths: ``l_i``, the largest length of a row of each contact; 1 if all its rows are zero, shape (h,).
        rows: A, padded and scaled, shape (h m, nv).
        shape: (h, m).
        start: b, padded and scaled, shape (h, m).
    """

    __slots__ = ("_delassus", "_place", "exact", "largest", "lengths", "rows", "scale", "shape", "start")

    def __init__(
        self, gradients: np.ndarray, offset: np.ndarray, sizes: np.ndarray, *, exact: bool = True, speed: float = 0.0
    ):
        sizes = np.asarray(sizes)
        n, h, m = len(offset), len(sizes), int(sizes.max(initial=1))
        self.exact = exact
        self.shape = (h, m)
        self._place = None
        A = gradients
        if n != h * m:
            first = np.cumsum(sizes) - sizes
            self._place = np.arange(n) + np.repeat(np.arange(h) * m - first, sizes)
            A = np.zeros((h * m, gradients.shape[1]))
            A[self._place] = gradients
        norms = np.sqrt(np.vecdot(A, A)).reshape(h, m).max(axis=1, initial=0.0)
        self.lengths = norms if np.count_nonzero(norms) == h else np.where(norms > 0, norms, 1.0)
        each = np.repeat(self.lengths, m)
        self.rows = A / each[:, None]
        self._delassus: np.ndarray | None = None
        self._start(offset, speed)

    @property
    def delassus(self) -> np.ndarray:
        """The Delassus matrix ``rows rows^T``, computed when first needed, shape (h m, h m)."""
        if self._delassus is None:
            self._delassus = self.rows @ self.rows.T
        return self._delassus

    def _start(self, offset: np.ndarray, speed: float) -> None:
        self.start = self._padded(offset) / self.lengths[:, None]
        self.largest = max(sqrt(np.vecdot(self.start, self.start).max(initial=0.0)), _TINY)
        self.scale = max(speed, self.largest)

    def _padded(self, values: np.ndarray) -> np.ndarray:
        """Return values of the rows, (n,), with zeros for padding rows, (h, m)."""
        if self._place is None:
            return values.reshape(self.shape)
        padded = np.zeros(self.shape)
        padded.reshape(-1)[self._place] = values
        return padded

    def starting(self, offset: np.ndarray, speed: float) -> ConeProblem:
        """Return the problem of the same contacts with another offset, (n,), and speed."""
        problem = copy(self)
        problem._start(offset, speed)
        return problem

    @property
    def relaxed(self) -> ConeProblem:
        """The problem of the same contacts with the convex relaxation of friction."""
        problem = copy(self)
        problem.exact = False
        return problem

    @property
    def is_redundant(self) -> bool:
        """Whether there are more rows than degrees of freedom, so that impulses are not unique."""
        return len(self.rows) > self.rows.shape[1]

    def scaled(self, impulse: np.ndarray) -> np.ndarray:
        """Return an impulse, (n,), padded and scaled, (h, m)."""
        return self._padded(impulse) * self.lengths[:, None]

    def unscaled(self, x: np.ndarray) -> np.ndarray:
        """Return the impulse, (n,), of a scaled one, (h, m)."""
        flat = (x / self.lengths[:, None]).reshape(-1)
        return flat if self._place is None else flat[self._place]

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """Return ``u / l``, (h, m), of a scaled impulse."""
        flat = x.reshape(-1)
        return self.start + self.rows.dot(flat.dot(self.rows)).reshape(self.shape)

    def residual(self, x: np.ndarray, u: np.ndarray) -> float:
        """Return the length of the natural map ``x - P_K(x - u - |u_t| e_n)``, sqrt(J), of scaled impulse and velocity.

        For the convex relaxation the map is ``x - P_K(x - u)``. It is zero if and only if the complementarity condition
        holds. Since K is self-dual, ``x - P_K(x - w) = w - P_K(w - x)``; the second form also detects errors of w that
        are smaller than the rounding errors of large impulses x.
        """
        if self.exact and self.shape[1] > 1:
            u = u.copy()
            u[:, 0] += np.sqrt(np.vecdot(u[:, 1:], u[:, 1:]))
        difference = (u - project(u - x)).reshape(-1)
        length = sqrt(difference.dot(difference))
        return length if length >= 0 else inf

    def answer(self, x: np.ndarray, residual: float, status: Status, iterations: int) -> ConeAnswer:
        """Return the answer of a scaled impulse."""
        return ConeAnswer(self.unscaled(x), x.reshape(-1).dot(self.rows), residual, status, iterations)


def project(x: np.ndarray) -> np.ndarray:
    """Return the projections of points onto ``K = {(a, y) : |y| <= a}``, row by row, (h, m)."""
    a = x[:, 0]
    if x.shape[1] == 1:
        return np.maximum(x, 0.0)
    y = x[:, 1:]
    r = np.sqrt(np.vecdot(y, y))
    normal = np.where(r <= a, a, np.maximum(0.5 * (a + r), 0.0))
    nearest = np.empty_like(x)
    nearest[:, 0] = normal
    nearest[:, 1:] = y * (np.minimum(normal, r) / np.maximum(r, _TINY))[:, None]
    return nearest


def projection_derivative(x: np.ndarray) -> np.ndarray:
    """Return a generalized derivative of `project` at each row, (h, m, m), symmetric with eigenvalues in [0, 1]."""
    h, m = x.shape
    a, y = x[:, 0], x[:, 1:]
    r = np.sqrt(np.vecdot(y, y))
    inside, outside = r <= a, r <= -a
    length = np.maximum(r, _TINY)
    direction = y / length[:, None]
    ratio = np.where(inside | outside, 0.0, a / length)[:, None, None]
    D = np.empty((h, m, m))
    D[:, 0, 0] = 0.5
    D[:, 0, 1:] = D[:, 1:, 0] = 0.5 * direction
    D[:, 1:, 1:] = 0.5 * ((1.0 + ratio) * np.eye(m - 1) - ratio * direction[:, :, None] * direction[:, None, :])
    D[inside] = np.eye(m)
    D[outside] = 0.0
    return D
