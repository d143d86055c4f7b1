"""A full restitution matrix: velocities of one contact decide what another one does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from impactlaw import deferred
from impactlaw.collision import Collision
from impactlaw.errors import RestitutionError
from impactlaw.laws.base import RestitutionLaw, coefficient, square_matrix
from impactlaw.laws.labels import canonical, put


@dataclass(frozen=True, eq=False)
class Fremond(RestitutionLaw):
    """``gamma^h = -E gamma-`` with any matrix E (Frémond).

    Attributes:
        matrix: E, shape (h, h), for exactly h contacts in their order; or a mapping from pairs of contact labels
            ``(i, j)`` to ``E_ij``, entries not named being zero. ``(i, i)`` with one and the same label is the
            coefficient of each contact of that label with itself.

    Raises:
        RestitutionError: not square, not finite, a key is not a pair of contact labels, or one has two values.
    """

    matrix: ArrayLike | Mapping[tuple[str, str], float]

    def __post_init__(self):
        if not isinstance(self.matrix, Mapping):
            object.__setattr__(self, "matrix", square_matrix(self.matrix))
            return
        table = {}
        for key, value in self.matrix.items():
            if not isinstance(key, tuple) or len(key) != 2:
                raise RestitutionError(f'a key of Fremond is a pair of contact labels ("b1/b2", "b2/b3"), got {key!r}')
            try:
                number = float(value)
            except (TypeError, ValueError):
                number = np.nan
            if not np.isfinite(number):
                raise RestitutionError(f"entry {key} of the restitution matrix must be a finite number, got {value!r}")
            put(table, (canonical(key[0]), canonical(key[1])), number)
        object.__setattr__(self, "matrix", table)

    @staticmethod
    def reversal(restitution: float = 1.0) -> Reversal:
        """Return the law of Newton's cradle: ``e`` times the anti-identity along the contacts' order."""
        return Reversal(restitution)

    @property
    def contact_labels(self) -> frozenset[str]:
        """Labels the law was keyed with, in canonical order; empty if it was not."""
        keys = self.matrix if isinstance(self.matrix, dict) else ()
        return frozenset(name for pair in keys for name in pair)

    def restitution_matrix(self, collision: Collision) -> np.ndarray:
        """Return E for the contacts of this collision, shape (h, h).

        Raises:
            RestitutionError: the matrix is for another number of contacts.
        """
        h = len(collision.labels)
        if isinstance(self.matrix, np.ndarray):
            if len(self.matrix) != h:
                raise RestitutionError(
                    f"restitution matrix is {self.matrix.shape} but {h} contacts collide "
                    f"({', '.join(collision.labels)}); key it by contact labels so that it follows the contacts"
                )
            return self.matrix
        table: dict[tuple[str, str], float] = self.matrix  # pyright: ignore[reportAssignmentType]
        names = [canonical(label) for label in collision.labels]
        E = np.zeros((h, h))
        for i, row in enumerate(names):
            for j, column in enumerate(names):
                if i == j or row != column:
                    E[i, j] = table.get((row, column), 0.0)
        return E


@dataclass(frozen=True)
class Reversal(RestitutionLaw):
    """``e`` times the anti-identity along the contacts' order: a chain of equal balls passes its velocities on.

    For N equal balls on a line and any number launched, v+ is v- reversed (e = 1): Newton's cradle. Contacts that
    do not influence each other (separate blocks of the Delassus matrix) are reversed block by block.

    Attributes:
        restitution: e in [0, 1].

    Raises:
        RestitutionError: e is not a number in [0, 1].
    """

    restitution: float = 1.0

    def __post_init__(self):
        object.__setattr__(self, "restitution", coefficient(self.restitution))

    def restitution_matrix(self, collision: Collision) -> np.ndarray:
        """Return ``e`` times the anti-identity on every block of connected contacts, shape (h, h)."""
        h = len(collision.labels)
        E = np.zeros((h, h))
        if h == 0:
            return E
        scale = collision.gradient_norms
        coupled = np.abs(collision.delassus) > 1e-12 * np.outer(scale, scale)
        blocks, member = deferred.connected_components(coupled, directed=False)
        for block in range(blocks):
            contacts = np.flatnonzero(member == block)
            E[contacts, contacts[::-1]] = self.restitution
        return E
