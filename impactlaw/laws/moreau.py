"""Moreau's half-line, E = e 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlaw.laws.base import RestitutionLaw, Target, coefficient
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True)
class Moreau(RestitutionLaw):
    """``E = e 1``: ``v+ = (1 + e) p - e v-`` with p the point of maximal dissipation.

    e in [0, 1] goes along the Moreau half-line (Aeberhard and Glocker, "Perfect multi-contact collisions").

    Attributes:
        restitution: e in [0, 1].

    Raises:
        RestitutionError: e is not a number in [0, 1].
    """

    restitution: float
    name = "moreau"
    description = "E = e 1: one coefficient, the half-line from v- through the point of maximal dissipation"

    @property
    def common_coefficient(self) -> float:
        """The coefficient."""
        return self.restitution

    def __post_init__(self):
        object.__setattr__(self, "restitution", coefficient(self.restitution))

    def restitution_matrix(self, collision: Collision) -> np.ndarray:
        """Return ``e 1``, shape (h, h)."""
        return self.restitution * np.eye(len(collision.labels))

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h = -e gamma-``, the contact velocities of ``u = -e v-``."""
        return Target(-self.restitution * collision.pre_contact_velocity, coefficient=self.restitution)
