"""Newton's law with one coefficient per contact, E = diag(e_1 .. e_h)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from impactlaw.collision import Collision
from impactlaw.errors import RestitutionError
from impactlaw.laws.base import RestitutionLaw, Target, coefficient
from impactlaw.laws.labels import canonical, put


@dataclass(frozen=True)
class Newton(RestitutionLaw):
    """``E = diag(e_1 .. e_h)``: ``gamma+_i >= -e_i gamma-_i``, with equality where a contact carries an impulse.

    Never has distant effects when every contact closes (``gamma- <= 0``).

    Attributes:
        restitution: one coefficient in [0, 1] for every contact, a sequence with one per contact, or a mapping from
            contact labels, ``("ball1", "floor")`` or ``"ball1/floor"`` in either order, to coefficients.
        default: coefficient of contacts that the mapping does not name; without it such a contact is an error.

    Raises:
        RestitutionError: a coefficient is not in [0, 1], a contact has two, or a default is given without a mapping.
    """

    restitution: float | Sequence[float] | Mapping[str | tuple[str, str], float]
    default: float | None = field(default=None, kw_only=True)

    def __post_init__(self):
        value = self.restitution
        if isinstance(value, Mapping):
            table: dict[str, float] = {}
            for key, e in value.items():
                put(table, canonical(key), coefficient(e, f"restitution of {canonical(key)}"))
            value = table
        elif isinstance(value, str) or not np.iterable(value):
            value = coefficient(value)
        else:
            value = tuple(coefficient(e, f"restitution of contact {i}") for i, e in enumerate(value))  # pyright: ignore[reportArgumentType]
        object.__setattr__(self, "restitution", value)
        if self.default is not None:
            if not isinstance(value, dict):
                raise RestitutionError("Newton's default is for a mapping from contact labels to coefficients")
            object.__setattr__(self, "default", coefficient(self.default, "default restitution"))

    @property
    def contact_labels(self) -> frozenset[str]:
        """Labels the law was keyed with, in canonical order; empty if it was not."""
        return frozenset(self._table or ())

    def coefficients(self, collision: Collision) -> np.ndarray:
        """Return ``e_1 .. e_h`` for the contacts of this collision, shape (h,).

        Raises:
            RestitutionError: as many coefficients as contacts are needed; or a contact is not named and no default set.
        """
        h = len(collision.labels)
        value, table = self.restitution, self._table
        if table is not None:
            return np.array([self._lookup(table, label) for label in collision.labels])
        if isinstance(value, tuple):
            if len(value) != h:
                raise RestitutionError(
                    f"Newton has {len(value)} coefficients but {h} contacts collide ({', '.join(collision.labels)}); "
                    "key them by contact label so that they follow the contacts"
                )
            return np.array(value)
        return np.full(h, value)

    def restitution_matrix(self, collision: Collision) -> np.ndarray:
        """Return ``diag(e_1 .. e_h)``, shape (h, h)."""
        return np.diag(self.coefficients(collision))

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h_i = -e_i gamma-_i``; equal coefficients also give the velocity ``-e v-``."""
        e = self.coefficients(collision)
        common = float(e[0]) if len(e) and (e == e[0]).all() else None
        return Target(-e * collision.pre_contact_velocity, coefficient=common)

    @property
    def _table(self) -> dict[str, float] | None:
        return self.restitution if isinstance(self.restitution, dict) else None  # pyright: ignore[reportReturnType]

    def _lookup(self, table: dict[str, float], label: str) -> float:
        e = table.get(canonical(label), self.default)
        if e is None:
            raise RestitutionError(f"no restitution for contact {label}, and no default")
        return e
