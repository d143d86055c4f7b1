"""Resolve all collisions at one instant: apply the law repeatedly until no closed contact approaches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from impactlaw.errors import InadmissibleImpactError, UnsolvableLawError
from impactlaw.laws import Coulomb, Law, Target
from impactlaw.laws.base import aim
from impactlaw.laws.tolerances import INFLUENCE
from impactlaw.mechanics.admissible.violations import Violations, measured, pushed
from impactlaw.mechanics.bilateral import Bilateral
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction import Friction
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.mechanics.impact import Impact
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.scene.contacts import Contacts, mass_matrix
from impactlaw.solvers.friction.problem import ENOUGH
from impactlaw.solvers.problem import row_lengths
from impactlaw.stepping.impact_event import ImpactEvent, is_kept
from impactlaw.stepping.work import Work

_SAME_INERTIA = 1e-14  # relative difference of mass matrices that is rounding where bodies only turn


class Closed(NamedTuple):
    """Closed contacts, and the constraints on impulses at them."""

    contacts: Contacts  # the contacts
    jacobian: np.ndarray  # gap gradients of the contacts, (h, nv)
    bilateral: np.ndarray | None = None  # gradients of equality constraints, (m, nv); None if there are none
    drift: np.ndarray | None = None  # contact velocities due to moving surfaces, m/s, (h,); None if none move
    drift_before: np.ndarray | None = None  # the same before a jump of the surfaces' velocity; None if there is no jump
    friction: Friction | None = None  # friction of the contacts; None if they have none

    def contact_velocity(self, velocity: np.ndarray) -> np.ndarray:
        """Return ``J v + w``, m/s, (h,)."""
        gamma = self.jacobian.dot(velocity)
        return gamma if self.drift is None else gamma + self.drift

    def coupled(self, metric: KineticMetric) -> np.ndarray:
        """Return which contacts an impulse on each contact, friction included, influences, bool (h, h)."""
        J, owner = self.jacobian, np.arange(len(self.contacts))
        if self.friction is not None:
            J, owner = np.vstack([J, self.friction.jacobian]), np.concatenate([owner, self.friction.contact])
        Y = metric.whiten_gradients(J)
        if self.bilateral is not None:
            Y = Bilateral.of(metric.whiten_gradients(self.bilateral)).project(Y)
        norms = row_lengths(Y)
        rows = np.abs(Y.dot(Y.T)) > INFLUENCE * norms[:, None] * norms
        if self.friction is None:
            return rows
        found = np.zeros((len(self.contacts), len(self.contacts)), dtype=bool)
        np.logical_or.at(found, (owner[:, None], owner), rows)
        return found

    def collision(self, metric: KineticMetric, velocity: np.ndarray) -> Collision:
        """Return the collision of these contacts at a velocity, (nv,)."""
        before, after = self.drift_before, self.drift
        return Collision(
            metric.mass_matrix,
            self.jacobian,
            velocity,
            labels=self.contacts.labels,
            metric=metric,
            bilateral_jacobian=self.bilateral,
            surface_velocity=after if before is None else before,
            post_surface_velocity=None if before is None else after,
            friction=self.friction,
        )

    def select(self, which: np.ndarray) -> Closed:
        """Return the chosen contacts, int (k,), ascending."""
        if len(which) == len(self.contacts):
            return self
        return Closed(
            self.contacts.select(which),
            self.jacobian[which],
            self.bilateral,
            _part(self.drift, which),
            _part(self.drift_before, which),
            None if self.friction is None else self.friction.select(which),
        )

    def resting(self, velocity: np.ndarray, rounding: np.ndarray) -> Closed:
        """Return the same contacts, where only the surfaces under resting contacts jump.

        A contact that separates from the surface before the jump sees only the surface velocity after the jump.
        """
        if self.drift is None or self.drift_before is None:
            return self
        rests = np.abs(self.jacobian @ velocity + self.drift_before) <= rounding
        return self._replace(drift_before=np.where(rests, self.drift_before, self.drift))


@dataclass(frozen=True)
class Collider:
    """Resolves collisions by a law.

    Only contacts with ``gamma- <= 0`` take part, since a law is a map from -T_C, and contacts that open slowly. Of
    these, only contacts that an impulse can reach take part. A contact that separates and is then driven closed by the
    others collides next, at the same time.
    """

    law: Law  # the law
    last_law: Law  # the law with E = 0, for the last of too many collisions
    # what to do with an outcome outside of S(v-): "raise" an error, "project" it onto S(v-), or "allow" it
    on_inadmissible: Literal["raise", "project", "allow"]
    most: int  # number of collisions in one step after which the last law resolves all closed contacts at once
    solver: str  # a name from `impactlaw.solvers.SOLVERS`, or "auto"

    def collide(
        self,
        metric: KineticMetric,
        closed: Closed,
        velocity: np.ndarray,
        *,
        approach: np.ndarray,
        rounding: np.ndarray,
        opening: float = 0.0,
        time: float,
        qpos: np.ndarray,
        events: list[ImpactEvent],
        work: Work | None = None,
    ) -> np.ndarray:
        """Return the velocity after all collisions, (nv,), and append one event for each collision.

        Args:
            metric: the kinetic metric.
            closed: the closed contacts.
            velocity: v-, (nv,).
            approach: closing speed, m/s, (h,), above which a contact collides.
            rounding: contact velocity, m/s, (h,), up to which a contact counts as not separating.
            opening: larger bound on the contact velocity, m/s, up to which contacts that open take part, too: the law
                treats them as closed and still.
            time: time of the collision, s.
            qpos: configuration of the collision, (nq,).
            events: the events of the step so far.
            work: counts the work of the step, if that is limited.

        Raises:
            InadmissibleImpactError: an outcome leaves S(v-) and on_inadmissible is "raise".
            UnsolvableLawError: the law has no solution.
            UnfinishedStepError: the collisions take too much work.
        """
        coupled = None
        closed = closed.resting(velocity, rounding)
        while True:
            gamma = closed.contact_velocity(velocity)
            approaching = gamma < -approach
            if not np.count_nonzero(approaching):
                return velocity
            final = len(events) >= self.most
            if final:
                chosen = np.arange(len(gamma))
            else:
                chosen = (gamma <= np.maximum(rounding, opening)).nonzero()[0]
                if np.count_nonzero(approaching[chosen]) < len(chosen):
                    if coupled is None and work is not None:
                        work.couple(len(gamma) + (0 if closed.friction is None else len(closed.friction)))
                    coupled = closed.coupled(metric) if coupled is None else coupled
                    chosen = _reached(coupled, chosen, approaching)
            if work is not None:
                work.collide(len(chosen), friction=closed.friction is not None)
            some = closed.select(chosen)
            collision = some.collision(metric, velocity)
            law = self.last_law if final else self.law
            limited = {"effort": work} if work is not None and isinstance(law, Coulomb) else {}
            if not final and np.count_nonzero(gamma[chosen] > rounding[chosen]):
                impact = self._as_closed(law, collision, limited)
                if impact is None:
                    opening = 0.0
                    continue
            else:
                impact = law.resolve(collision, solver=self.solver, **limited)
            by_law, impact = impact, self._admissible(impact, rounding[chosen], time)
            events.append(ImpactEvent(time, some.contacts, impact, qpos.copy(), impact is not by_law))
            before, velocity = velocity, impact.post_velocity
            if final or not np.count_nonzero(before != velocity):  # what changes nothing now changes nothing next time
                return velocity
            closed = closed._replace(drift_before=None)

    def _as_closed(self, law: Law, collision: Collision, limited: dict[str, Work]) -> Impact | None:
        """Return the impact by the law if contacts that open slowly count as still.

        Return None if the law then has no solution, or the impact loses restitution or leaves S(v-): a push against a
        contact that opens can create a little energy, and a contact that opens can oppose one that closes.
        """
        try:
            impact = as_closed(law).resolve(collision, solver=self.solver, **limited)
        except UnsolvableLawError:
            return None
        return impact if is_kept(impact) else None

    def _admissible(self, impact: Impact, rounding: np.ndarray, time: float) -> Impact:
        if self.on_inadmissible == "allow":
            return impact
        collision, after = impact.collision, impact.post_contact_velocity
        opened = after >= -_sharp(impact, rounding)  # what opened by rounding may close by rounding
        opens = np.count_nonzero(opened) == len(opened)
        if opens and impact.__class__ is Impact and _violations_if_open(impact).is_admissible():
            return impact
        v = impact.violations
        if v.is_admissible() or (opens and replace(v, kinematic=0.0).is_admissible()):
            return impact
        if self.on_inadmissible == "project":
            if not collision.has_admissible_set:
                return self.last_law.resolve(collision, solver=self.solver)
            return Impact.observed(collision, collision.admissible_set.project(impact.post_velocity))
        before = collision.kinetic_energy
        ratio = 1 + impact.energy_change / before if before > 0 else np.inf
        raise InadmissibleImpactError(
            f"{self.law!r} leaves the set of possible velocities at t = {time:.6g} s for contacts "
            f"{', '.join(collision.labels)}: energy ratio T+/T- = {ratio:.6g}, violations in sqrt(J): {v}; choose a "
            'dissipative law, or on_inadmissible="project" or "allow"'
        )


@dataclass(frozen=True)
class _AsClosed(Law):
    """A law that treats contacts that open before the collision as still."""

    law: Law

    @property
    def normal_law(self) -> Law:
        """The normal law of the inner law."""
        return self.law.normal_law

    def target(self, collision: Collision) -> Target:
        """Return the target of the inner law for ``min(gamma-, 0)``."""
        opens, surface = np.maximum(collision.pre_contact_velocity, 0.0), collision.surface_velocity
        still = replace(collision, surface_velocity=-opens if surface is None else surface - opens)
        return Target(aim(self.law, still).contact_velocity)


def as_closed(law: Law) -> Law:
    """Return the law that treats opening contacts as still; a law with its own rule for impulses stays as it is."""
    if isinstance(law, Coulomb):
        return replace(law, law=as_closed(law.law))
    return _AsClosed(law) if law.has_target else law


def _violations_if_open(impact: Impact) -> Violations:
    """Return the violations without that of penetration, which may take a solver."""
    c, jump = impact.collision, impact.whitened_jump
    return measured(c, jump, np.zeros(0), *pushed(c, jump, impact.found_impulse), c.pre_speed)


def _sharp(impact: Impact, rounding: np.ndarray) -> np.ndarray:
    """Return the accuracy of the contact velocities of an outcome, (h,).

    It is that of rounding, or of the solver's certificate if that is coarser.
    """
    if not isinstance(impact, FrictionImpact) or impact.cones is None:
        return rounding
    return np.maximum(rounding, ENOUGH * impact.cones.scale * impact.cones.lengths)


def _part(values: np.ndarray | None, chosen: np.ndarray) -> np.ndarray | None:
    return None if values is None else values[chosen]


def _reached(coupled: np.ndarray, candidates: np.ndarray, approaching: np.ndarray) -> np.ndarray:
    """Return the indices of the candidates that an impulse of an approaching contact reaches through others."""
    coupled = coupled[np.ix_(candidates, candidates)]
    reached = approaching[candidates]
    count = 0
    while count < (count := int(np.count_nonzero(reached))):
        reached = reached | coupled[reached].any(axis=0)
    return candidates[reached]


def kinetic_metric(model: mujoco.MjModel, data: mujoco.MjData, *, known: KineticMetric | None = None) -> KineticMetric:
    """Return the kinetic metric at the current frames, or the known one if the mass matrix is the same."""
    M = mass_matrix(model, data)
    if known is not None and not np.count_nonzero(np.abs(M - known.mass_matrix) > _SAME_INERTIA * np.abs(M)):
        return known
    return KineticMetric(M)
