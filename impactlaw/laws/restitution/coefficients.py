"""One coefficient of restitution per contact: a number, one per contact, keyed by labels, or a function of speed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import coefficient
from impactlaw.laws.restitution.labels import OfContacts, checked_values
from impactlaw.mechanics.collision import Collision

_MOST_SHOWN = 32  # entries of a mapping that `repr` shows

Coefficient = float | Callable[[float], float]
"""e, or e as a function of the speed at which a contact closes."""
Coefficients = Coefficient | Sequence[Coefficient] | Mapping[str | tuple[str, str], Coefficient]
"""One coefficient for all contacts, one for each contact in order, or a mapping from contact labels."""


@dataclass(frozen=True, repr=False)
class ContactCoefficients(OfContacts):
    """The coefficients ``e_1 .. e_h`` of a law that has one for each contact.

    Any coefficient may be a function instead of a number. It is called for each contact with the speed at which that
    contact closes, ``max(0, -gamma-_i)`` (a float, m/s; rad/s at hinges), and returns e in [0, 1].

    Attributes:
        restitution: one coefficient for every contact, a sequence with one per contact, or a mapping from contact
            labels, ``("ball1", "floor")`` or ``"ball1/floor"`` in either order, or patterns of these
            (`restitution.labels`), to coefficients. A sequence fits only collisions of exactly as many contacts, in
            their order, which changes while a scene moves; labels follow the contacts.
        default: coefficient of contacts that the mapping does not name. Without a default such a contact raises an
            error, and a stepper refuses the law if the scene can have one.

    Raises:
        RestitutionError: a coefficient is not in [0, 1], a contact has two coefficients, a mapping is empty and there
            is no default, a default is given without a mapping, or coefficients are a set, which has no order.
    """

    restitution: Coefficients
    default: Coefficient | None = field(default=None, kw_only=True)

    def __post_init__(self):
        value = checked_values(self.restitution, "restitution", _checked, type(self).__name__)
        if value == {} and self.default is None:
            raise RestitutionError(f"{type(self).__name__} has no coefficient: an empty mapping, and no default")
        object.__setattr__(self, "restitution", value)
        if self.default is not None:
            if not isinstance(value, dict):
                raise RestitutionError(
                    f"{type(self).__name__}'s default is for a mapping from contact labels to coefficients"
                )
            object.__setattr__(self, "default", _checked(self.default, "default restitution"))

    def __repr__(self) -> str:
        return f"{type(self).__name__}(restitution={_shown(self.restitution)}, default={_shown(self.default)})"

    def coefficients(self, collision: Collision) -> np.ndarray:
        """Return ``e_1 .. e_h`` for the contacts of this collision, shape (h,)."""
        labels, name = collision.labels, type(self).__name__
        if isinstance(self.restitution, float):
            return np.full(len(labels), self.restitution)
        given = self._of_contacts(labels, "coefficients")
        if None in given:
            missing = labels[given.index(None)]
            raise RestitutionError(f"{name} has no restitution for contact {missing}, and no default: give one")
        if any(map(callable, given)):
            speeds = np.maximum(-collision.pre_contact_velocity, 0.0).tolist()
            given = [_at(e, speed, label) for e, speed, label in zip(given, speeds, labels, strict=True)]
        return np.array(given, dtype=float)


def described(value: object) -> object:
    """Return the qualified name of a function; any other value unchanged."""
    name = getattr(value, "__qualname__", None)
    return f"{getattr(value, '__module__', None)}.{name}" if callable(value) and name else value


def _checked(value: Any, name: str) -> Any:
    return value if callable(value) else coefficient(value, name)


def _at(e: Any, speed: float, label: str) -> float:
    """Return the coefficient at a closing speed; raise `RestitutionError` if it is not a number in [0, 1]."""
    if not callable(e):
        return e
    name = f"restitution {described(e)} of contact {label} at speed {speed:.6g}"
    try:
        value = e(speed)
    except (ArithmeticError, TypeError) as error:
        raise RestitutionError(f"{name} cannot be computed: {error}") from error
    return coefficient(value, name)


def _shown(value: object) -> str:
    if isinstance(value, dict):
        shown = [f"{key!r}: {_shown(e)}" for key, e in islice(value.items(), _MOST_SHOWN)]
        if len(value) > _MOST_SHOWN:
            shown.append(f"... {len(value) - _MOST_SHOWN} more")
        return "{" + ", ".join(shown) + "}"
    if isinstance(value, tuple):
        return "(" + ", ".join(map(_shown, value)) + ("," if len(value) == 1 else "") + ")"
    name = described(value)
    return repr(value) if name is value else str(name)
