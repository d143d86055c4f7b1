"""Friction of the contacts of a collision: gradients of sliding, spinning and rolling, and their coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import InvalidCollisionError
from impactlaw.mechanics.arrays import finite_array


class ConeRows(NamedTuple):
    """How h normal rows and k rows of friction form the h + k rows of the cone problem."""

    order: np.ndarray  # ``[normal rows, rows of friction][order]`` is contact by contact, normal first
    sizes: np.ndarray  # rows of each contact, shape (h,)


@dataclass(frozen=True, eq=False)
class Friction:
    """Rows of friction of some contacts, with elliptic cones ``sum (Lambda_k / mu_k)^2 <= Lambda_n^2`` like MuJoCo's.

    The sliding velocities are ``gamma_t = J_t v + w_t``.

    Attributes:
        jacobian: ``J_t``, shape (k, nv): tangential rows in m/s, torsional and rolling ones in rad/s.
        contact: the contact that each row belongs to, ascending, shape (k,).
        coefficient: ``mu_k > 0`` of each row, shape (k,); 1, or m for torsion and rolling.
        surface_velocity: ``w_t-``, shape (k,): the part of ``gamma_t-`` that does not come from v-; zeros if None.
        post_surface_velocity: ``w_t+``, shape (k,); ``w_t-`` if None.

    Raises:
        InvalidCollisionError: shapes do not fit, an entry is not finite, a coefficient is not positive, or the contacts
            are not ascending.
    """

    jacobian: np.ndarray
    contact: np.ndarray
    coefficient: np.ndarray
    surface_velocity: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    post_surface_velocity: np.ndarray = None  # pyright: ignore[reportAssignmentType]

    def __post_init__(self):
        jacobian = finite_array(self.jacobian, "friction jacobian")
        if jacobian.ndim != 2:
            raise InvalidCollisionError(f"friction jacobian must have shape (k, nv), got {jacobian.shape}")
        k = len(jacobian)
        contact = np.array(self.contact, dtype=int if k == 0 else None)
        contact.flags.writeable = False
        if contact.shape != (k,) or contact.dtype.kind not in "iu":
            raise InvalidCollisionError(f"friction contact must be {k} integers, one per row, got {self.contact!r}")
        if k and (contact[0] < 0 or (contact[1:] < contact[:-1]).any()):
            raise InvalidCollisionError(f"friction contact must be ascending and not negative, got {contact}")
        before = np.zeros(k) if self.surface_velocity is None else self.surface_velocity
        after = before if self.post_surface_velocity is None else self.post_surface_velocity
        values = {"coefficient": self.coefficient, "surface_velocity": before, "post_surface_velocity": after}
        values = {name: finite_array(value, f"friction {name}", (k,)) for name, value in values.items()}
        if (values["coefficient"] <= 0).any():
            raise InvalidCollisionError("a friction coefficient must be positive; leave out rows without friction")
        for name, value in {"jacobian": jacobian, "contact": contact, **values}.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.contact)

    def check(self, contacts: int, nv: int) -> None:
        """Raise `InvalidCollisionError` if rows are not of length nv or belong to contacts that do not exist."""
        if self.jacobian.shape[1] != nv:
            raise InvalidCollisionError(f"friction jacobian must have {nv} columns, got {self.jacobian.shape}")
        if len(self) and self.contact[-1] >= contacts:
            raise InvalidCollisionError(f"friction of contact {self.contact[-1]}, but there are {contacts} contacts")

    def select(self, indices: ArrayLike) -> Friction | None:
        """Return the friction of distinct contacts, renumbered 0, 1, ... in this order; None if they have no rows."""
        indices = np.asarray(indices, dtype=int)
        first = np.searchsorted(self.contact, indices, side="left")
        count = np.searchsorted(self.contact, indices, side="right") - first
        contact = np.repeat(np.arange(len(indices)), count)
        if not len(contact):
            return None
        rows = np.arange(len(contact)) + np.repeat(first - (np.cumsum(count) - count), count)
        parts = self.coefficient, self.surface_velocity, self.post_surface_velocity
        return Friction(self.jacobian[rows], contact, *(part[rows] for part in parts))

    def without(self, rows: np.ndarray) -> Friction | None:
        """Return the friction without the rows marked in bool (k,); None if no row is left."""
        if rows.all():
            return None
        parts = self.jacobian, self.contact, self.coefficient, self.surface_velocity, self.post_surface_velocity
        return Friction(*(part[~rows] for part in parts))

    @cached_property
    def surface_jump(self) -> np.ndarray:
        """``w_t+ - w_t-``, shape (k,)."""
        return self.post_surface_velocity - self.surface_velocity
