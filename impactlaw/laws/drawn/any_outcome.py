"""A law that is any law: outcomes drawn from the set of possible right-velocities."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace

from impactlaw.errors import SolverError
from impactlaw.laws.base import Target
from impactlaw.laws.drawn.drawing import DrawnLaw
from impactlaw.laws.poisson import Poisson
from impactlaw.mechanics.admissible.cone import EnumerationError
from impactlaw.mechanics.collision import Collision

_MOST_CONTACTS = 16  # at once, whose S is sampled uniformly: chains take time like the cube of that


@dataclass(frozen=True)
class AnyOutcome(DrawnLaw):
    """v+ is drawn from S(v-), uniformly in its volume: `AdmissibleSet.sample`.

    One contact by itself has ``gamma+ = -e gamma-`` with e uniform in [0, 1]. The seed is that of `DrawnLaw`.
    `Scattered` draws around a law instead. Friction is left out when v+ is drawn, as with it there is no S;
    ``Coulomb(AnyOutcome())``, which rigid steppers make by themselves, adds it to the contact velocities drawn.

    Where more than 16 contacts collide, where faces of S are too many to be listed (`cone.MAX_FACETS`) or lost to
    rounding, and where surfaces move against each other, the outcome is that of Poisson's law with a coefficient for
    each contact, uniform in [0, 1]. That is in S, but not every point of S is one of these.
    """

    seed: int | None = field(default=None, kw_only=True)
    name = "any-outcome"
    description = "v+ drawn from S(v-), uniformly: every possible collision; takes no restitution"
    takes_restitution = False

    def target(self, collision: Collision) -> Target:
        """Return the contact velocities of the outcome that belongs to this collision, and the outcome."""
        c, rng = collision, self.generator(collision)
        if len(c.labels) == 1 and c.frame_rates is None:
            e = rng.random()
            return Target(-e * c.pre_contact_velocity, coefficient=e)
        c, v = c if c.friction is None else replace(c, friction=None), None
        if c.has_admissible_set and len(c.labels) <= _MOST_CONTACTS:
            with suppress(EnumerationError, SolverError):
                v = c.admissible_set.sample(1, rng)[0]
        if v is None:
            v = Poisson(rng.random(len(c.labels)).tolist()).resolve(c).post_velocity
        return Target(c.contact_velocity_after(v), v)
