"""Newton's law with one coefficient per contact, E = diag(e_1 .. e_h)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlaw.laws.base import RestitutionLaw, Target
from impactlaw.laws.restitution.coefficients import Coefficient, Coefficients, ContactCoefficients  # noqa: F401  (types of inherited fields)
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True, repr=False)
class Newton(ContactCoefficients, RestitutionLaw):
    """``E = diag(e_1 .. e_h)``: ``gamma+_i >= -e_i gamma-_i``, with equality where a contact carries an impulse.

    This is the diagonal case of the extended Newton impact law (Aeberhard and Glocker, "Perfect multi-contact
    collisions"). It has no distant effects when every contact closes (``gamma- <= 0``). The coefficients are numbers or
    functions of the speed at which a contact closes, see `ContactCoefficients`.
    """

    name = "newton"
    description = "E = diag(e_1 .. e_h): one coefficient per contact, also keyed by its label or a function of speed"
    per_contact = True

    @property
    def common_coefficient(self) -> float | None:
        """The coefficient, if every contact has the same number; else None."""
        return self.restitution if isinstance(self.restitution, float) else None

    def restitution_matrix(self, collision: Collision) -> np.ndarray:
        """Return ``diag(e_1 .. e_h)``, shape (h, h)."""
        return np.diag(self.coefficients(collision))

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h_i = -e_i gamma-_i``, and the coefficient if all are equal."""
        e = self.coefficients(collision)
        values = set(e.tolist())
        return Target(-e * collision.pre_contact_velocity, coefficient=values.pop() if len(values) == 1 else None)
