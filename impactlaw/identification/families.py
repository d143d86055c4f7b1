"""The families of laws that can be fitted: their parameters, the law that these make, and where friction comes from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from impactlaw.errors import MeasurementError
from impactlaw.identification.measurements import Measurements
from impactlaw.laws import Compliant, Coulomb, Law, Moreau, Newton, Poisson, Reversal, Routh
from impactlaw.mechanics.collision import Collision

_STIFFEST = 1e4  # ratio of stiffness to that of the first contact that is looked for
_WIDE, _NARROW = (0.0, 3.0, -3.0, 6.0, -6.0), (0.0, 4.0, -4.0)  # logarithms of such ratios where searches begin
_SEARCHES = 4
_RATIOS = ((), (), _WIDE, _WIDE, _NARROW)  # for so many contacts


@dataclass(frozen=True)
class Parameter:
    """One number of a law."""

    name: str  # for tables
    low: float  # least value
    high: float  # largest value
    starts: tuple[float, ...]  # where the search begins


@dataclass(frozen=True)
class Family:
    """A family of laws over the contacts of some measurements."""

    name: str  # of the family
    parameters: tuple[Parameter, ...]  # its numbers
    make: Callable[[np.ndarray], Law]  # the law of these numbers
    # the largest coefficient of friction of the collisions, which the last parameter takes the place of; 0 if none does
    largest: float = 0.0
    # from so many of the best starts one goes on, until it fits: several where there are local minima
    searches: int = 1

    def predicted(self, measured: Measurements, values: np.ndarray) -> list[np.ndarray]:
        """Return v+ of all collisions, (nv,) each."""
        mu = float(values[-1]) if self.largest else None
        return outcomes(self.make(values), measured.collisions, mu, self.largest)


def outcomes(
    law: Law, collisions: Sequence[Collision], friction: float | None = None, largest: float = 1.0
) -> list[np.ndarray]:
    """Return v+ of collisions, (nv,) each, with another friction where one is given; see `with_friction`."""
    if friction is not None:
        collisions = [with_friction(c, friction, largest) for c in collisions]
    return [law.resolve(c).post_velocity for c in collisions]


def largest_friction(collisions: Sequence[Collision]) -> float:
    """Return the largest coefficient of friction of sliding that collisions were given; 0 if none has friction."""
    return max((_sliding_coefficients(c).max(initial=0.0) for c in collisions), default=0.0)


def _sliding_coefficients(collision: Collision) -> np.ndarray:
    friction = collision.friction
    if friction is None or not len(friction):
        return np.zeros(0)
    return friction.coefficient[np.unique(friction.contact, return_index=True)[1]]


def with_friction(collision: Collision, coefficient: float, largest: float | None = None) -> Collision:
    """Return the collision with a coefficient of friction in the place of ``largest``, its own if None.

    All coefficients keep their ratios.

    One without friction, such as that of limits of joints, is returned itself.
    """
    friction = collision.friction
    if friction is None or not len(friction):
        return collision
    scaled = coefficient / (largest or largest_friction([collision])) * friction.coefficient
    return replace(collision, friction=replace(friction, coefficient=scaled))


def _restitution(name: str = "restitution") -> Parameter:
    return Parameter(name, 0.0, 1.0, (0.5, 0.95))


def _single(name: str, law: Callable[[float], Law]) -> Callable[[Measurements], Family]:
    return lambda measured: Family(name, (_restitution(),), lambda x: law(float(x[0])))


def _per_contact(name: str, law: Callable[[object], Law]) -> Callable[[Measurements], Family]:
    def family(measured: Measurements) -> Family:
        labels = measured.labels
        if len(labels) == 1:
            return _single(name, law)(measured)
        parameters = tuple(_restitution(f"restitution {label}") for label in labels)
        return Family(name, parameters, lambda x: law(dict(zip(labels, x.tolist(), strict=True))))

    return family


def _sliding(name: str, law: Callable[[float], Law]) -> Callable[[Measurements], Family]:
    def family(measured: Measurements) -> Family:
        largest = largest_friction(measured.collisions)
        if not largest:
            raise MeasurementError(
                f"family {name!r} needs tangential directions, but no collision has any: give friction_jacobian, or "
                "sliding velocities"
            )
        mu = Parameter("friction", 1e-6, 5.0, (0.3,))
        return Family(name, (_restitution(), mu), lambda x: law(float(x[0])), largest=largest)

    return family


def _compliant(measured: Measurements) -> Family:
    labels = measured.labels
    e = Parameter("restitution", 0.01, 1.0, (0.98, 0.5))
    if len(labels) == 1:
        return Family("compliant", (e,), lambda x: Compliant(1.0, restitution=float(x[0])))
    exponent = Parameter("exponent", 1.0, 4.0, (1.5,))
    starts = _RATIOS[len(labels)] if len(labels) < len(_RATIOS) else (0.0,)
    ratios = tuple(
        Parameter(f"log stiffness {label} over {labels[0]}", -np.log(_STIFFEST), np.log(_STIFFEST), starts)
        for label in labels[1:]
    )

    def make(x: np.ndarray) -> Law:
        k: dict[str | tuple[str, str], float] = {labels[0]: 1.0}
        k |= zip(labels[1:], np.exp(x[2:]).tolist(), strict=True)
        return Compliant(k, exponent=float(x[1]), restitution=float(x[0]))

    return Family("compliant", (e, exponent, *ratios), make, searches=_SEARCHES)


FAMILIES: dict[str, Callable[[Measurements], Family] | None] = {
    "moreau": _single("moreau", Moreau),
    "newton": _per_contact("newton", Newton),  # pyright: ignore[reportArgumentType]
    "poisson": _per_contact("poisson", Poisson),  # pyright: ignore[reportArgumentType]
    "reversal": _single("reversal", Reversal),
    "fremond": None,  # see restitution_matrix
    "coulomb": _sliding("coulomb", lambda e: Coulomb(Newton(e))),
    "routh": _sliding("routh", Routh),
    "compliant": _compliant,
}
"""What `fit` knows."""
