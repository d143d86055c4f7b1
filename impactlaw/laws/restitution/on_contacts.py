"""A law for some contacts only: the others have E = 0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import Law, Target, aim
from impactlaw.laws.friction.coulomb import Coulomb
from impactlaw.laws.maximal_dissipation import MaximalDissipation
from impactlaw.laws.moreau import Moreau
from impactlaw.laws.newton import Newton
from impactlaw.laws.restitution.coefficients import ContactCoefficients
from impactlaw.laws.restitution.labels import canonical
from impactlaw.mechanics.collision import Collision


@dataclass(frozen=True)
class Chosen:
    """A choice among the contacts that a scene can have: those with these canonical labels, or all others."""

    labels: frozenset[str]
    others: bool = False

    def mask(self, labels: Sequence[str]) -> np.ndarray:
        """Return which of these contacts are chosen, bool (h,)."""
        return np.array([(canonical(label) in self.labels) != self.others for label in labels], dtype=bool)


@dataclass(frozen=True)
class OnContacts(Law):
    """The target of a law on the chosen contacts, as if they collided alone, and ``gamma^h = 0`` on the others.

    For a diagonal E this is E with zeros for the others. A law that couples contacts sees the chosen ones only.
    """

    law: Law
    chosen: Chosen

    def __repr__(self) -> str:
        return f"{self.law!r} on some contacts"

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h``, which is 0 for contacts that are not chosen."""
        which = np.flatnonzero(self.chosen.mask(collision.labels))
        if len(which) == len(collision.labels):
            return aim(self.law, collision)
        wanted = np.zeros(len(collision.labels))
        if len(which):
            wanted[which] = aim(self.law, replace(collision, friction=None).part(which)).contact_velocity
        return Target(wanted)


def restricted(law: Law, chosen: Chosen) -> Law:
    """Return the law for the contacts that are chosen, with E = 0 for the others.

    Raises:
        RestitutionError: the law has its own rule for impulses, and no coefficients that could be set to 0.
    """
    if isinstance(law, MaximalDissipation):
        return law
    if isinstance(law, Coulomb):
        return replace(law, law=restricted(law.law, chosen))
    if isinstance(law, Moreau):
        law = Newton(law.restitution)
    if isinstance(law, ContactCoefficients) and law.contact_count is None:
        return _with_zeros(law, chosen)
    if law.has_target:
        return OnContacts(law, chosen)
    raise RestitutionError(
        f"{law!r:.100} cannot be for some contacts only, since it has a rule of its own for impulses; key its "
        "coefficients by contact labels, or give one for all, or leave contacts and limits out"
    )


def _with_zeros(law: Any, chosen: Chosen) -> Law:
    """Return the law with coefficient 0 for the contacts that are not chosen."""
    if not isinstance(law.restitution, Mapping):
        law = replace(law, restitution={}, default=law.restitution)
    if chosen.others:
        return replace(law, restitution={**law.restitution, **dict.fromkeys(sorted(chosen.labels), 0.0)})
    return replace(law, restitution={label: law.named(label) for label in sorted(chosen.labels)}, default=0.0)
