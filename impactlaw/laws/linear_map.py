"""A law given by a linear map of velocities instead of contact velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import Law, Target, square_matrix
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True, eq=False)
class LinearMap(Law):
    """``v+ = prox(h v-)``, the point of ``v- - T_C^perp`` that is nearest to ``h v-`` in the kinetic metric.

    ``gamma^h = J h v-``, so that a solution always exists (Aeberhard and Glocker, ``sigma_l(v-, h)``).

    Attributes:
        h: the linear map, shape (nv, nv).

    Raises:
        RestitutionError: h is not a finite square matrix.
    """

    h: ArrayLike

    def __post_init__(self):
        object.__setattr__(self, "h", square_matrix(self.h, "linear map"))

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h = J h v-``, the contact velocities of ``u = h v-``; ``+ w+`` where surfaces move.

        Raises:
            RestitutionError: h is for another number of degrees of freedom.
        """
        h = np.asarray(self.h)
        if len(h) != len(collision.pre_velocity):
            raise RestitutionError(
                f"linear map is {h.shape} but the velocity has {len(collision.pre_velocity)} entries"
            )
        u = h @ collision.pre_velocity
        return Target(collision.contact_velocity_after(u), u)
