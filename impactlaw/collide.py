"""Collisions at one instant: the law, again and again, until no closed contact approaches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from impactlaw.collision import Collision
from impactlaw.contacts import Contacts
from impactlaw.errors import InadmissibleImpactError
from impactlaw.events import ImpactEvent
from impactlaw.impact import Impact
from impactlaw.laws import Law, MaximalDissipation
from impactlaw.metric import KineticMetric


@dataclass(frozen=True)
class Collider:
    """Resolves collisions by a law.

    Only contacts with ``gamma- <= 0`` take part, since a law is a map from -T_C, and of those only the ones that an
    impulse can reach. A contact that separates and is driven closed by the others collides next, at the same time.

    Attributes:
        law: the law.
        on_inadmissible: what to do with an outcome outside of S(v-): "raise", "project" it onto S(v-), or "allow" it.
        most: collisions of one step after which E = 0 on every closed contact ends the matter.
        solver: a name from `impactlaw.solvers.SOLVERS`, or "auto".
    """

    law: Law
    on_inadmissible: Literal["raise", "project", "allow"]
    most: int
    solver: str

    def collide(
        self,
        metric: KineticMetric,
        jacobian: np.ndarray,
        contacts: Contacts,
        velocity: np.ndarray,
        *,
        approach: np.ndarray,
        rounding: np.ndarray,
        time: float,
        qpos: np.ndarray,
        events: list[ImpactEvent],
    ) -> np.ndarray:
        """Return the velocity after all collisions, (nv,), and append one event for each.

        Args:
            metric: mass matrix.
            jacobian: gap gradients of the closed contacts, (h, nv).
            contacts: those contacts.
            velocity: v-, (nv,).
            approach: speed of closing, m/s, (h,), above which a contact collides.
            rounding: contact velocity, m/s, (h,), up to which a contact counts as not separating.
            time: of the collision, s.
            qpos: configuration of the collision, (nq,).
            events: of the step so far.

        Raises:
            InadmissibleImpactError: an outcome leaves S(v-) and on_inadmissible is "raise".
            UnsolvableLawError: the law has no solution.
        """
        Y = None
        while True:
            gamma = jacobian @ velocity
            approaching = gamma < -approach
            if not approaching.any():
                return velocity
            final = len(events) >= self.most
            if final:
                chosen = np.arange(len(gamma))
            else:
                Y = metric.whiten_gradients(jacobian) if Y is None else Y
                chosen = _reached(Y, np.flatnonzero(gamma <= rounding), approaching)
            part = contacts.select(chosen)
            collision = Collision(metric.mass_matrix, jacobian[chosen], velocity, labels=part.labels, metric=metric)
            law = MaximalDissipation() if final else self.law
            impact = self._admissible(law.resolve(collision, solver=self.solver), time)
            events.append(ImpactEvent(time, part, impact, qpos.copy()))
            before, velocity = velocity, impact.post_velocity
            if final or np.array_equal(before, velocity):  # a law that changes nothing changes nothing the next time
                return velocity

    def _admissible(self, impact: Impact, time: float) -> Impact:
        if self.on_inadmissible == "allow":
            return impact
        v = impact.violations
        if v.is_admissible():
            return impact
        collision = impact.collision
        if self.on_inadmissible == "project":
            return Impact.observed(collision, collision.admissible_set.project(impact.post_velocity))
        ratio = 1 + impact.energy_change / collision.kinetic_energy
        raise InadmissibleImpactError(
            f"{self.law!r} leaves the set of possible velocities at t = {time:.6g} s for contacts "
            f"{', '.join(collision.labels)}: energy ratio T+/T- = {ratio:.6g}, violations kinematic {v.kinematic:.2g}, "
            f"energetic {v.energetic:.2g} sqrt(J); choose a dissipative law, or "
            'on_inadmissible="project" or "allow"'
        )


def _reached(gradients: np.ndarray, candidates: np.ndarray, approaching: np.ndarray) -> np.ndarray:
    """Return the candidates that an impulse of an approaching contact can reach through others, as indices."""
    if approaching[candidates].all():
        return candidates
    Y = gradients[candidates]
    norms = np.linalg.norm(Y, axis=1)
    coupled = np.abs(Y @ Y.T) > 1e-12 * np.outer(norms, norms)
    reached = approaching[candidates]
    count = 0
    while count < (count := int(np.count_nonzero(reached))):
        reached = reached | coupled[reached].any(axis=0)
    return candidates[reached]
