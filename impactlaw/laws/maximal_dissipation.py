"""The point of maximal dissipation, E = 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import RestitutionLaw, Target
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True)
class MaximalDissipation(RestitutionLaw):
    """``E = 0``: v+ is the point of S(v-) of least energy, the projection of v- onto the tangent cone ``J v >= 0``.

    ``0 <= Lambda  ⊥  gamma+ >= 0``, or ``min |v+ - v-|`` subject to ``J v+ >= 0``, in the kinetic metric.

    The point of maximal dissipation (Aeberhard and Glocker, "Perfect multi-contact collisions").
    """

    name = "maximal-dissipation"
    description = "E = 0: the least kinetic energy that no penetration allows; takes no restitution"
    takes_restitution = False

    @classmethod
    def of(cls, restitution: Any) -> MaximalDissipation:
        """Return the law; the only restitution that it can be given is 0.

        Raises:
            RestitutionError: it is given another one.
        """
        if restitution is not None and (getattr(restitution, "ndim", 0) or restitution != 0):
            raise RestitutionError(f"law {cls.name!r} has restitution 0, got {restitution!r}; leave it out")
        return cls()

    @property
    def common_coefficient(self) -> float:
        """Zero."""
        return 0.0

    def restitution_matrix(self, collision: Collision) -> np.ndarray:
        """Return zeros, shape (h, h)."""
        return np.zeros((len(collision.labels),) * 2)

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h = 0``, the contact velocities of ``u = 0``."""
        return Target(np.zeros(len(collision.labels)), coefficient=0.0)
