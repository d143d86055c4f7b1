"""What a stepper reports about a collision."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property, reduce
from operator import add
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
        contacts: the contacts that collided, with their labels, geoms, gaps, positions and normals.
        impact: the outcome; ``impact.collision`` holds the mass matrix, the Jacobian and the velocity before.
        qpos: the configuration at the collision, (nq,).
        projected: whether this is not the law's own outcome: that one left S(v-) and was replaced, or in a time step
            scaled; or no impulses of the law were found that lead to the velocity of the time step.
        judged: whether the time step has found that the law creates energy; None for other events.
    """

    time: float
    contacts: Contacts
    impact: Impact
    qpos: np.ndarray = field(default_factory=lambda: np.zeros(0))
    projected: bool = False
    judged: bool | None = None

    @property
    def inadmissible(self) -> bool:
        """Whether the law's own outcome left S(v-).

        A time step judges that by the work of contact in the step, with all its forces. `impact` is the collision by
        itself, which may gain energy where the step does not, and the other way round.
        """
        return self.projected or not is_kept(self.impact) if self.judged is None else self.judged

    def __repr__(self) -> str:
        """Return one line, without matrices."""
        labels, lost = ", ".join(self.contacts.labels), self.impact.energy_change
        return f"<ImpactEvent at {self.time:.6g} s: {labels}, T+ - T- = {lost:.4g} J>"


class ImpactSums(NamedTuple):
    """Sums over collisions; compiled steps compute them without making an event of each collision."""

    collisions: int = 0  # number of collisions
    energy_change: float = 0.0  # sum of ``T+ - T-``, J
    surface_work: float = 0.0  # the part of it that is work of moving surfaces and of drifted equality constraints, J
    intensity: float = 0.0  # sum of ``|v+ - v-|`` in the kinetic metric, sqrt(J)
    distant: int = 0  # number of collisions with a distant effect
    inadmissible: int = 0  # number of collisions whose outcome left S(v-) and was projected, scaled or let through

    @classmethod
    def of(cls, events: Iterable[ImpactEvent]) -> ImpactSums:
        """Return the sums over events."""
        total = cls()
        for event in events:
            impact = event.impact
            distant, work = int(impact.has_distant_effect), impact.surface_work
            left = int(event.inadmissible)
            total = total.with_more(cls(1, impact.energy_change, work, impact.intensity, distant, left))
        return total

    def with_more(self, other: ImpactSums) -> ImpactSums:
        """Return the sums over the collisions of both operands."""
        return self._make(map(add, self, other))


NOTHING = ImpactSums()
"""The sums of a step without collisions."""


def is_kept(impact: Impact) -> bool:
    """Return whether the impact keeps all restitution and its outcome is in S(v-)."""
    scaled = isinstance(impact, FrictionImpact) and impact.restitution_scale < 1.0
    return not scaled and impact.violations.is_admissible()


LazyEvents = tuple[ImpactEvent, ...] | Callable[[], tuple[ImpactEvent, ...]]
"""Collisions, or a function that returns them; it may have an attribute `sums` with the sums over them."""


def changed_model(time: float) -> SceneError:
    """Return the error for events that are read after the model has changed."""
    return SceneError(
        f"the model was changed after the step at t = {time:.6g} s: compiled steps tell their collisions by taking the "
        'step once more; ask for events before the model changes, or take compiled="never"'
    )


def sums_of(told: LazyEvents) -> ImpactSums:
    """Return the sums over collisions; events are resolved only if the sums are not known."""
    if not told:
        return NOTHING
    known = getattr(told, "sums", None)
    return ImpactSums.of(told() if callable(told) else told) if known is None else known


class Collisions:
    """Collisions of several steps, in order."""

    def __init__(self, parts: list[LazyEvents]):
        self._parts = parts

    def __call__(self) -> tuple[ImpactEvent, ...]:
        """Return the events of all steps."""
        return tuple(event for part in self._parts for event in (part() if callable(part) else part))

    @cached_property
    def sums(self) -> ImpactSums:
        """Sums over the collisions of all steps."""
        return reduce(ImpactSums.with_more, map(sums_of, self._parts), NOTHING)


def together(parts: list[LazyEvents]) -> LazyEvents:
    """Return the collisions of all parts as one."""
    if len(parts) == 1:
        return parts[0]
    return Collisions(parts) if parts else ()
