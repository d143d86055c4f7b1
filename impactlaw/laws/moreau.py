"""Moreau's half-line, E = e 1."""

from __future__ import annotations

from dataclasses import dataclass

from impactlaw.laws.base import RestitutionLaw, coefficient


@dataclass(frozen=True)
class Moreau(RestitutionLaw):
    """``E = e 1``: ``v+ = (1 + e) p - e v-`` with p the point of maximal dissipation.

    As e goes from 0 to 1, v+ moves along the Moreau half-line (Aeberhard and Glocker, "Perfect multi-contact
    collisions").

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
