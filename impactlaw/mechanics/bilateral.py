"""Impulses that leave bilateral constraints alone, and velocities relative to surfaces that move.

Bilateral constraints ``J_eq v+ = J_eq v-`` get impulses too. In whitened coordinates, ``z = R^T v``, they confine the
jump to the null space of ``Y_eq = J_eq R^-T``: the impulse of a contact with gradient ``y`` makes the jump ``P y``, P
being the orthogonal projection onto that space. So the law sees ``Y P`` in the place of ``Y``, the same as in minimal
coordinates. Redundant constraints do no harm, for P knows their span only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw.mechanics.tolerances import FIXED, REACHED, VELOCITY_RANK
from impactlaw.solvers.least_squares import row_span
from impactlaw.solvers.tolerances import RANK


class Bilateral(NamedTuple):
    """The directions that bilateral constraints fix."""

    basis: np.ndarray  # of their span in whitened coordinates, orthonormal rows, (r, nv)
    combination: np.ndarray  # ``basis = combination @ Y_eq``, (r, m)

    @classmethod
    def of(cls, whitened: np.ndarray) -> Bilateral:
        """Return the span of the whitened gradients ``Y_eq`` of the constraints, (m, nv), redundant ones included."""
        return cls(*row_span(whitened, RANK))

    def project(self, gradients: np.ndarray) -> np.ndarray:
        """Return ``Y P``, (h, nv): gradients without their part along the constraints; 0 where that is all."""
        B = self.basis
        projected = gradients - gradients @ B.T @ B
        projected -= projected @ B.T @ B  # a second time for what rounding left in the first
        fixed = np.vecdot(projected, projected) <= FIXED**2 * np.vecdot(gradients, gradients)
        projected[fixed] = 0.0
        return projected

    def confine(self, jacobian: np.ndarray, whitened: np.ndarray, constraints: np.ndarray) -> np.ndarray:
        """Return J' with ``J' R^-T = J R^-T P``, (h, nv), of J, ``J R^-T`` and ``J_eq``: that leaves these alone."""
        return jacobian - whitened @ self.basis.T @ self.combination @ constraints

    def along(self, whitened_velocity: np.ndarray) -> np.ndarray | None:
        """Return the part of a velocity that the constraints fix, (nv,); None if it is rounding: they are at rest."""
        part = self.basis @ whitened_velocity
        if part @ part <= FIXED**2 * (whitened_velocity @ whitened_velocity):
            return None
        return part @ self.basis


class Reached(NamedTuple):
    """A whitened velocity z, (nv,), that comes nearest to ``Y z = rates``, and whether that holds."""

    velocity: np.ndarray
    is_exact: bool


def velocity_with(gradients: np.ndarray, rates: np.ndarray) -> Reached:
    """Return a small whitened velocity with these contact velocities, or the nearest to them."""
    lengths = np.sqrt(np.vecdot(gradients, gradients))
    lengths[lengths == 0] = 1.0
    unit, wanted = gradients / lengths[:, None], rates / lengths
    z = np.linalg.lstsq(unit, wanted, rcond=VELOCITY_RANK)[0]
    missed = np.abs(unit @ z - wanted).max(initial=0.0)
    return Reached(z, bool(missed <= REACHED * np.abs(wanted).max(initial=0.0)))
