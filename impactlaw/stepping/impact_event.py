"""What a stepper reports of a collision."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np

from impactlaw.errors import SceneError
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.mechanics.impact import Impact
from impactlaw.scene.contacts import Contacts


@dataclass(frozen=True, eq=False)
class ImpactEvent:
    """One collision during a step.

    Attributes:
        time: simulation time of the collision, s.
        contacts: the contacts that collided: their labels, geoms, gap, position, normal.
        impact: the outcome; ``impact.collision`` holds mass matrix, Jacobian and velocity before.
        qpos: the configuration it happened at, (nq,).
        projected: whether the outcome by the law left S(v-), and this is another one.
    """

    time: float
    contacts: Contacts
    impact: Impact
    qpos: np.ndarray = field(default_factory=lambda: np.zeros(0))
    projected: bool = False


class ImpactSums(NamedTuple):
    """Sums over collisions; compiled steps know them without making an event of each."""

    collisions: int = 0  # how many
    energy_change: float = 0.0  # of ``T+ - T-``, J
    surface_work: float = 0.0  # what moving surfaces did of that, and equality constraints that had drifted, J
    intensity: float = 0.0  # of ``|v+ - v-|`` in the kinetic metric, sqrt(J)
    distant: int = 0  # collisions with a distant effect
    inadmissible: int = 0  # collisions whose outcome by the law left S(v-) and was projected, scaled or let through

    @classmethod
    def of(cls, events: Iterable[ImpactEvent]) -> ImpactSums:
        """Sum up events."""
        total = cls()
        for event in events:
            impact = event.impact
            distant, work = int(impact.has_distant_effect), impact.surface_work
            inadmissible = int(event.projected or _is_inadmissible(impact))
            total = total.with_more(cls(1, impact.energy_change, work, impact.intensity, distant, inadmissible))
        return total

    def with_more(self, other: ImpactSums) -> ImpactSums:
        """Return the sums over the collisions of both."""
        return ImpactSums(
            self.collisions + other.collisions,
            self.energy_change + other.energy_change,
            self.surface_work + other.surface_work,
            self.intensity + other.intensity,
            self.distant + other.distant,
            self.inadmissible + other.inadmissible,
        )


NOTHING = ImpactSums()
"""The sums over no collision."""


def _is_inadmissible(impact: Impact) -> bool:
    """Whether the outcome by the law left S(v-): it was scaled or let through."""
    scaled = isinstance(impact, FrictionImpact) and impact.restitution_scale < 1.0
    return scaled or not impact.violations.is_admissible()


Told = tuple[ImpactEvent, ...] | Callable[[], tuple[ImpactEvent, ...]]
"""Collisions, or what returns them, which may know the sums over them: an attribute `sums`."""


def changed_model(time: float) -> SceneError:
    """Return the error of events that are asked for too late."""
    return SceneError(
        f"the model was changed after the step at t = {time:.6g} s: compiled steps tell their collisions by taking the "
        'step once more; ask for events before the model changes, or take compiled="never"'
    )


def sums_of(told: Told) -> ImpactSums:
    """Return the sums over collisions; where they are known no event is resolved."""
    if not told:
        return NOTHING
    known = getattr(told, "sums", None)
    return ImpactSums.of(told() if callable(told) else told) if known is None else known


class Collisions:
    """Collisions of several steps, in their order."""

    def __init__(self, parts: list[Told]):
        self._parts = parts

    def __call__(self) -> tuple[ImpactEvent, ...]:
        """Return them as events."""
        return tuple(event for part in self._parts for event in (part() if callable(part) else part))

    @cached_property
    def sums(self) -> ImpactSums:
        """Sums over all of them."""
        return reduce(ImpactSums.with_more, map(sums_of, self._parts), NOTHING)


def together(parts: list[Told]) -> Told:
    """Return what tells the collisions of all parts."""
    if len(parts) == 1:
        return parts[0]
    return Collisions(parts) if parts else ()
