"""Impulses that leave bilateral constraints alone, and velocities relative to surfaces that move.

Bilateral constraints ``J_eq v+ = J_eq v-`` get impulses too. In whitened coordinates, ``z = R^T v``, they confine the
jump to the null space of ``Y_eq = J_eq R^-T``: the impulse of a contact with gradient ``y`` makes the jump ``P y``, P
being the orthogonal projection onto that space. So the law sees ``Y P`` in the place of ``Y``, the same as in minimal
coordinates. Redundant constraints do no harm, for P knows their span only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw import deferred

_RANK = 1e-11  # relative singular value below which a constraint depends on the others
_INDEPENDENT = 1e-15  # relative singular value up to which a velocity is not asked for
_FIXED = 1e-12  # part of a gradient that is rounding after the projection
_REACHED = 1e-11  # part of the contact velocities that a velocity of the bodies may miss


class Bilateral(NamedTuple):
    """An orthonormal basis of the directions that bilateral constraints fix, in whitened coordinates, (r, nv)."""

    basis: np.ndarray

    @classmethod
    def of(cls, whitened: np.ndarray) -> Bilateral:
        """Return the span of the whitened gradients of the constraints, (m, nv), redundant ones included."""
        lengths = np.sqrt(np.vecdot(whitened, whitened))
        rows = whitened[lengths > 0] / lengths[lengths > 0, None]
        return cls(deferred.orth(rows.T, rcond=_RANK).T)

    def project(self, gradients: np.ndarray) -> np.ndarray:
        """Return ``Y P``, (h, nv): gradients without their part along the constraints; 0 where that is all."""
        B = self.basis
        projected = gradients - gradients.dot(B.T).dot(B)
        projected -= projected.dot(B.T).dot(B)
        fixed = np.vecdot(projected, projected) <= _FIXED**2 * np.vecdot(gradients, gradients)
        projected[fixed] = 0.0
        return projected

    def along(self, whitened_velocity: np.ndarray) -> np.ndarray | None:
        """Return the part of a velocity that the constraints fix, (nv,); None if it is rounding: they are at rest."""
        part = self.basis.dot(whitened_velocity)
        if part.dot(part) <= _FIXED**2 * whitened_velocity.dot(whitened_velocity):
            return None
        return part.dot(self.basis)


def velocity_with(gradients: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the least whitened velocity z, (nv,), that comes nearest to ``Y z = rates``, and whether it is one."""
    lengths = np.sqrt(np.vecdot(gradients, gradients))
    lengths[lengths == 0] = 1.0
    unit, wanted = gradients / lengths[:, None], rates / lengths
    z = np.linalg.lstsq(unit, wanted, rcond=_INDEPENDENT)[0]
    missed = np.abs(unit.dot(z) - wanted).max(initial=0.0)
    return z, bool(missed <= _REACHED * np.abs(wanted).max(initial=0.0))
