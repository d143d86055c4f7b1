"""The point of maximal dissipation, E = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlaw.laws.base import RestitutionLaw, Target
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True)
class MaximalDissipation(RestitutionLaw):
    """``E = 0``: v+ is the point of S(v-) of least energy, the projection of v- onto the tangent cone.

    The point of maximal dissipation (Aeberhard and Glocker, "Perfect multi-contact collisions").
    """

    def restitution_matrix(self, collision: Collision) -> np.ndarray:
        """Return zeros, shape (h, h)."""
        return np.zeros((len(collision.labels),) * 2)

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h = 0``, the contact velocities of ``u = 0``."""
        return Target(np.zeros(len(collision.labels)), coefficient=0.0)
