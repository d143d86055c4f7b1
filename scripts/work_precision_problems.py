"""Impact problems with solutions known beyond double precision, at a wanted condition number.

Each is the law with E = e 1 in the coordinates in which the kinetic metric is Euclidean: w the velocity before,
``d = -(1 + e) w`` the jump that would reach the wanted contact velocities, the jump z the point nearest to d in the
cone of the gradients (rows of Y).
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext
from math import fsum

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.sparse import csr_array

from impactlaw.solvers import Problem

RESTITUTION = 0.5
_DIGITS = 60
_MARGIN = 1e-12  # part of the largest that multipliers and slacks of an exact solution must exceed


@dataclass(frozen=True, eq=False)
class ExactProblem:
    """A problem and its solution.

    Attributes:
        gradients: Y, (h, nv), dense or sparse.
        preimage: d, (nv,).
        jump: z rounded from many digits, (nv,).
    """

    gradients: np.ndarray | csr_array
    preimage: np.ndarray
    jump: np.ndarray

    @property
    def velocity(self) -> np.ndarray:
        """Velocity before the impact, (nv,), sqrt(J)."""
        return -self.preimage / (1 + RESTITUTION)

    def problem(self) -> Problem:
        """Return what solvers are given; the bound is computed in doubles, as it is from any scene."""
        speed = float(np.linalg.norm(self.velocity))
        bound = np.asarray(self.gradients @ self.preimage)
        return Problem(self.gradients, bound, self.preimage, speed)  # pyright: ignore[reportArgumentType]

    def errors(self, impulse: np.ndarray, jump: np.ndarray | None = None) -> tuple[float, float]:
        """Return how far an impulse is from the law, and its error of energy.

        With a jump z computed apart from the impulse, both are of that jump. The residual is the length of
        ``min(Lambda_i |Y_i|, (Y z - c)_i / |Y_i|)`` over |d|, z = Y^T Lambda; the error of energy is that of
        ``|w + z|^2 / 2`` over the energy before.
        """
        Y = self.gradients
        squared = Y.multiply(Y).sum(axis=1) if isinstance(Y, csr_array) else np.vecdot(Y, Y)
        lengths = np.sqrt(np.asarray(squared).ravel())
        z = np.asarray(Y.T @ impulse) if jump is None else jump
        slack = np.asarray(Y @ (z - self.preimage)) / lengths
        residual = np.linalg.norm(np.minimum(impulse * lengths, slack)) / np.linalg.norm(self.preimage)
        w, apart = self.velocity, z - self.jump
        energy = abs(apart @ (w + self.jump + 0.5 * apart)) / (0.5 * w @ w)
        return float(residual), float(energy)


def dense(h: int, condition: float, seed: int) -> ExactProblem:
    """Return h contacts on h degrees of freedom, a random Y of that condition number, half of the contacts active.

    Y = U diag(s) V^T with s from 1 to 1 / condition. The cone's nearest point is planted: ``d = Y^T Lambda + n`` with
    Lambda > 0 on the active contacts, n orthogonal to them and ``Y n < 0`` on the others (by the sign of their rows).
    For the doubles that Y and d then are, the solution is computed again in decimals.

    Raises:
        ArithmeticError: rounding has made another set of contacts active.
    """
    rng = np.random.default_rng([h, seed])
    U, V = (np.linalg.qr(rng.normal(size=(h, h)))[0] for _ in range(2))
    Y = (U * np.logspace(0, -np.log10(condition), h)) @ V.T if h > 1 else np.ones((1, 1))
    active = np.arange(h) < max(1, h // 2)
    z = rng.uniform(0.5, 1.5, active.sum()) @ (Y[active] / np.linalg.norm(Y[active], axis=1)[:, None])
    Q = np.linalg.qr(Y[active].T)[0]
    n = rng.normal(size=h)
    n -= Q @ (Q.T @ n)
    n -= Q @ (Q.T @ n)
    length = np.linalg.norm(n)
    n = n * (np.linalg.norm(z) / length) if h > active.sum() else np.zeros(h)
    Y[~active] *= -np.sign(Y[~active] @ n)[:, None]
    d = z + n
    return ExactProblem(Y, d, _project(Y, d, active))


def _project(Y: np.ndarray, d: np.ndarray, active: np.ndarray) -> np.ndarray:
    """Return the point nearest to d in the span of the active rows, in decimals, if it is that nearest in the cone."""
    with localcontext() as context:
        context.prec = _DIGITS
        rows = [np.array([Decimal(x) for x in row], dtype=object) for row in Y[active]]
        basis, left = [], np.array([Decimal(x) for x in d], dtype=object)
        triangle = np.full((len(rows), len(rows)), Decimal(0), dtype=object)
        along = []
        for i, row in enumerate(rows):
            for j, q in enumerate(basis):
                triangle[i, j] = q.dot(row)
                row = row - triangle[i, j] * q
            triangle[i, i] = row.dot(row).sqrt()
            basis.append(row / triangle[i, i])
            along.append(basis[-1].dot(left))
            left = left - along[-1] * basis[-1]
        impulse: list[Decimal] = [Decimal(0)] * len(rows)
        for i in reversed(range(len(rows))):
            reached = sum((impulse[k] * triangle[k, i] for k in range(i + 1, len(rows))), Decimal(0))
            impulse[i] = (along[i] - reached) / triangle[i, i]
        lengths = np.linalg.norm(Y, axis=1)
        separating = (
            np.array([float(-left.dot(np.array([Decimal(x) for x in row], dtype=object))) for row in Y[~active]])
            / lengths[~active]
        )
        carried = np.array([float(x) for x in impulse]) * lengths[active]
        exact = np.array([float(Decimal(x) - y) for x, y in zip(d, left, strict=True)])
    scale = _MARGIN * np.linalg.norm(d)
    if carried.min() <= scale or separating.min(initial=np.inf) <= scale:
        raise ArithmeticError("the planted solution is none of the rounded problem")
    return exact


def chain(contacts: int, condition: float, seed: int) -> ExactProblem:
    """Return balls on a line in touch, random velocities, masses over this condition number; Y is bidiagonal.

    The velocity of maximal dissipation p is the non-decreasing sequence nearest to v- in the kinetic metric, which
    pooling adjacent balls of decreasing mean velocity finds (isotonic regression); the means are summed exactly.
    """
    rng = np.random.default_rng([contacts, seed])
    n = contacts + 1
    mass = condition ** rng.uniform(-0.5, 0.5, n)
    v = -np.linspace(-1, 1, n) + 0.5 * rng.normal(size=n)
    pooled = isotonic_regression(v, weights=mass)
    p = np.empty(n)
    for begin, end in zip(pooled.blocks[:-1], pooled.blocks[1:], strict=True):
        own = slice(int(begin), int(end))
        p[own] = fsum(mass[own] * v[own]) / fsum(mass[own])
    root = np.sqrt(mass)
    index = np.arange(contacts)
    entries = np.concatenate([-1 / root[:-1], 1 / root[1:]])
    Y = csr_array((entries, (np.tile(index, 2), np.concatenate([index, index + 1]))), shape=(contacts, n))
    return ExactProblem(Y, -(1 + RESTITUTION) * root * v, (1 + RESTITUTION) * root * (p - v))
