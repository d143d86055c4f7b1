"""A law without preference: outcomes drawn uniformly from the set of possible right-velocities."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace

from impactlaw.errors import SolverError
from impactlaw.laws.base import Target
from impactlaw.laws.drawn.drawing import DrawnLaw
from impactlaw.laws.poisson import Poisson
from impactlaw.mechanics.admissible.cone import EnumerationError
from impactlaw.mechanics.collision import Collision

_MOST_CONTACTS = 16  # most contacts whose S is sampled: the time of hit-and-run grows with the cube of their number


@dataclass(frozen=True)
class AnyOutcome(DrawnLaw):
    """v+ is drawn from S(v-), uniformly in its volume: `AdmissibleSet.sample`.

    A single contact gets ``gamma+ = -e gamma-`` with e uniform in [0, 1]. For the seed see `DrawnLaw`. `Scattered`
    draws around the outcome of a law instead. v+ is drawn without friction, since S is defined only without it;
    ``Coulomb(AnyOutcome())``, which rigid steppers make by themselves, adds friction to the contact velocities drawn.

    In three cases the outcome is that of Poisson's law with a random coefficient, uniform in [0, 1], for each contact:
    more than 16 contacts collide; the faces of S are too many to list (`cone.MAX_FACETS`) or lost to rounding; or
    surfaces move against each other. Such an outcome is in S, but these outcomes do not fill S.
    """

    seed: int | None = field(default=None, kw_only=True)
    name = "any-outcome"
    description = "v+ drawn from S(v-), uniformly: every possible collision; takes no restitution"
    takes_restitution = False

    def target(self, collision: Collision) -> Target:
        """Return the outcome that belongs to this collision, and its contact velocities."""
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
