"""Projection onto velocity jumps that satisfy bilateral constraints, and velocities relative to moving surfaces.

Bilateral constraints ``J_eq v+ = J_eq v-`` act by impulses. In whitened coordinates, ``z = R^T v``, they confine the
jump to the null space of ``Y_eq = J_eq R^-T``: a unit impulse of a contact with gradient ``y`` makes the jump ``P y``,
where P is the orthogonal projection onto that space. The law therefore uses ``Y P`` instead of ``Y``, as in minimal
coordinates. Redundant constraints do no harm, since P depends on their span only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

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
        """Return ``Y P``, (h, nv): gradients less their part along the constraints; 0 if only rounding is left."""
        B = self.basis
        projected = gradients - gradients @ B.T @ B
        projected -= projected @ B.T @ B  # a second time, to remove the rounding errors of the first
        projected[np.vecdot(projected, projected) <= FIXED**2 * np.vecdot(gradients, gradients)] = 0.0
        return projected

    def confine(self, jacobian: np.ndarray, whitened: np.ndarray, constraints: np.ndarray) -> np.ndarray:
        """Return J' with ``J' R^-T = J R^-T P``, (h, nv), given J, ``J R^-T`` and ``J_eq``."""
        return jacobian - whitened @ self.basis.T @ self.combination @ constraints

    def along(self, whitened_velocity: np.ndarray) -> np.ndarray | None:
        """Return the part of a velocity that the constraints fix, (nv,); None if it is only rounding, at rest."""
        part = self.basis @ whitened_velocity
        if part @ part <= FIXED**2 * (whitened_velocity @ whitened_velocity):
            return None
        return part @ self.basis


class Reached(NamedTuple):
    """A whitened velocity z, (nv,), that solves ``Y z = rates`` in the least-squares sense, and whether exactly."""

    velocity: np.ndarray
    is_exact: bool


def eliminated(gradients: np.ndarray, constraints: np.ndarray, rank: int, inertia: np.ndarray) -> np.ndarray:
    """Return gradients less their part along constraints in coordinates that depend on others, which is 0, (h, nv).

    The projection of such a gradient has the rounding of what constraints leave of it, not that of all of it. Limits
    of two joints that a third one drives therefore stay opposite to each other, however little it moves them.

    Args:
        gradients: ``J``, (h, nv).
        constraints: ``J_eq``, (m, nv), redundant rows allowed.
        rank: rank of ``J_eq``, the number of coordinates that depend.
        inertia: the diagonal of M, (nv,): light coordinates depend on heavy ones.
    """
    depend = scipy.linalg.qr(constraints / np.sqrt(inertia), mode="r", pivoting=True)[1][:rank]
    rows = scipy.linalg.qr(constraints[:, depend].T, mode="r", pivoting=True)[1][:rank]
    J = gradients - gradients[:, depend] @ np.linalg.solve(constraints[np.ix_(rows, depend)], constraints[rows])
    J[:, depend] = 0.0
    return J


def velocity_with(gradients: np.ndarray, rates: np.ndarray) -> Reached:
    """Return the whitened velocity of least norm with these contact velocities, or with the nearest ones."""
    lengths = np.sqrt(np.vecdot(gradients, gradients))
    lengths[lengths == 0] = 1.0
    unit, wanted = gradients / lengths[:, None], rates / lengths
    z = np.linalg.lstsq(unit, wanted, rcond=VELOCITY_RANK)[0]
    missed = np.abs(unit @ z - wanted).max(initial=0.0)
    return Reached(z, bool(missed <= REACHED * np.abs(wanted).max(initial=0.0)))
