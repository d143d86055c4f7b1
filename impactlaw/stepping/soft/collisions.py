"""The collisions of soft stepping: which contacts close too fast, and the velocity that the law gives them."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.errors import SolverError, UnfinishedStepError, UnsolvableLawError
from impactlaw.laws import Coulomb, Law
from impactlaw.laws.restitution.on_contacts import Chosen
from impactlaw.mechanics.friction import Friction
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.scene.contacts import Contacts, active_contacts, closes, first_rows, gap_gradients, geom_names
from impactlaw.scene.equality_constraints import bilateral_constraints, bilateral_rows
from impactlaw.scene.friction_rows import active_friction
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.scratch import Scratch
from impactlaw.solvers.friction.solve import THOROUGH
from impactlaw.stepping.collisions import Closed, Collider, kinetic_metric
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.integration import is_huge
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.soft.drifting_limits import drifting
from impactlaw.stepping.soft.driving_constraints import Constraints, is_dragged
from impactlaw.stepping.soft.locked_joints import added_inertia, with_locked_joints
from impactlaw.stepping.soft.position_correction import put_back
from impactlaw.stepping.soft.pressed_contacts import approach_speed, pairs_before
from impactlaw.stepping.soft.rebounds import Normals, hold_back, normals
from impactlaw.stepping.soft.tolerances import FALLS, OPENING, REST_SPEED, ROUNDING, WORK
from impactlaw.stepping.work import Work

POSITION, VELOCITY = int(mujoco.mjtStage.mjSTAGE_POS), int(mujoco.mjtStage.mjSTAGE_VEL)
"""MuJoCo's stages."""
NOTHING: tuple[tuple[ImpactEvent, ...], int] = (), VELOCITY
"""The result of `Collisions.resolve` without a collision."""
_UNSOLVED = SolverError, UnsolvableLawError, UnfinishedStepError


class _Resolved(NamedTuple):
    """The velocity after collisions (None if it was not found), the collisions, and whether they lost restitution."""

    velocity: np.ndarray | None
    events: list[ImpactEvent]
    is_short: bool = False


class Collisions:
    """Resolves the contacts and limits that MuJoCo's solver acts on and that close faster than `rest_speed`.

    Attributes:
        model: the scene.
        collider: computes the velocity after collisions.
        given_speed: the option `rest_speed` of `Stepper`, m/s or rad/s; None if it is not given.
        friction: whether contacts have friction in collisions.
        chosen: the contacts to which the law applies; None for all.
        surfaces: moving mocap bodies and belts; None if there are none.
        names: names of geoms.
        limits: the limits of joints and tendons.
        bilateral: which equality constraints keep their velocity in a collision, bool (neq,).
        unlocated: number of times so far that there were more successive collisions than the collider allows.
        short_steps: number of times so far that collisions lost their restitution, since with friction or constraints
            there was no solution with it or finding one took too much work, or that they were left to MuJoCo's
            contacts, since there was none without restitution either.
    """

    def __init__(
        self, model: mujoco.MjModel, collider: Collider, plan: Plan, *, rest_speed: float | None, chosen: Chosen | None
    ):
        self.model = model
        self.collider, self.given_speed, self.friction, self.chosen = collider, rest_speed, plan.friction, chosen
        self.surfaces = Surfaces(model, plan.pairs.geoms) if plan.surfaces else None
        self.names, self.limits, self.bilateral = geom_names(model), Limits(model), bilateral_constraints(model)
        self.unlocated = self.short_steps = 0
        self._mass = float(model.body_mass[model.body_weldid > 0].sum())
        self._work = Work(model.nv, WORK, rounds=THOROUGH, once=True)
        self._earlier = Scratch(model)

    @property
    def rest_speed(self) -> float:
        """Closing speed above which a contact collides, m/s or rad/s; if not given, for timestep and gravity now."""
        option, given = self.model.opt, self.given_speed
        return max(REST_SPEED, FALLS * option.timestep * math.hypot(*option.gravity)) if given is None else given

    def resolve(self, data: mujoco.MjData, before: np.ndarray | None = None) -> tuple[tuple[ImpactEvent, ...], int]:
        """Change the velocity by the law; return the collisions and MuJoCo's last stage that is still current.

        Positions change, too, if MuJoCo's force would push a contact that the law opens, see `position_correction`.

        Args:
            data: the state, with contacts and velocities of constraint rows; changed.
            before: geoms of the contacts a step before, int32 (n, 2); if not given they are looked up where needed.
        """
        rows, speed, surfaces = data.efc_vel, self.rest_speed, self.surfaces
        still = surfaces is None or surfaces.still
        if (still and not closes(self.model, data, rows, speed)) or is_huge(data):  # MuJoCo's next check reports that
            return NOTHING
        if still and self._is_too_much(data):
            self.short_steps += 1
            return NOTHING
        closed = self.closed(data)
        gamma = closed.contact_velocity(data.qvel)
        approach = self._approach(data, closed, gamma, before)
        if not np.count_nonzero(gamma < -approach):  # contacts of flexes may close
            return NOTHING
        constraints = Constraints(self.model, data) if data.ne and self.bilateral.any() else None
        found = self._resolved(data, closed, gamma, approach, constraints)
        while constraints is not None and (driven := constraints.drive(found.events)).any():
            constraints.give_way(driven)
            found = self._resolved(data, closed, gamma, approach, constraints)
        if surfaces is not None and any(is_dragged(event.impact, self._mass) for event in found.events):
            found = _Resolved(None, [], is_short=True)
        self.short_steps += found.is_short
        if found.velocity is None:
            return NOTHING
        events = tuple(found.events)
        self.unlocated += len(events) > self.collider.most
        if np.array_equal(found.velocity, data.qvel):
            return events, VELOCITY
        closing, data.qvel[:] = data.qvel.copy(), found.velocity
        put_back(self.model, data, closing, self._normals(data), self.rest_speed)
        return events, POSITION

    def _resolved(
        self,
        data: mujoco.MjData,
        closed: Closed,
        gamma: np.ndarray,
        approach: np.ndarray,
        constraints: Constraints | None,
    ) -> _Resolved:
        """Resolve the collisions; equality constraints that do not give way keep their velocity in them."""
        if constraints is not None:
            closed, part = self._constrained(data, closed, gamma, constraints)
            gamma, approach = gamma[part], approach[part]
            if not np.count_nonzero(gamma < -approach):
                return _Resolved(None, [])
        if self.chosen is not None:
            part = np.flatnonzero(self.chosen.mask(closed.contacts.labels))
            closed, gamma, approach = closed.select(part), gamma[part], approach[part]
        events: list[ImpactEvent] = []
        try:
            velocity = self._collide(self.collider, data, closed, gamma, approach, events)
            impacts = (event.impact for event in events)
            lost = any(isinstance(impact, FrictionImpact) and impact.restitution_scale == 0.0 for impact in impacts)
            return _Resolved(velocity, events, is_short=lost)
        except _UNSOLVED as unsolved:
            if constraints is not None and constraints.drive(events).any():
                return _Resolved(None, events)
            events = []
            velocity = self._without_restitution(data, closed, gamma, approach, events)
            does_not_fit = self.collider.law.normal_law.common_coefficient is None  # else constraints hold a body still
            if velocity is not None and does_not_fit and isinstance(unsolved, UnsolvableLawError):
                raise
            return _Resolved(velocity, events, is_short=True)

    def _is_too_much(self, data: mujoco.MjData) -> bool:
        """Return whether the inertia of all bodies alone would exceed the work allowed for collisions with friction."""
        if not self.friction or not isinstance(self.collider.law, Coulomb) or not (data.contact.dim > 1).any():
            return False
        self._work.begin()
        try:
            self._work.collide(0, friction=True)
        except UnfinishedStepError:
            return True
        return False

    def hold_back(self, data: mujoco.MjData) -> bool:
        """Keep contacts that the law is for from bouncing by themselves; return whether any of them would have."""
        return hold_back(self.model, data, self._normals(data), self.rest_speed)

    def _normals(self, data: mujoco.MjData) -> Normals:
        return normals(self.model, data, self.names, self.limits, self.chosen, self.surfaces)

    def _constrained(
        self, data: mujoco.MjData, closed: Closed, gamma: np.ndarray, kept: Constraints
    ) -> tuple[Closed, np.ndarray]:
        """Return the contacts that take part, with the constraints that keep their velocity, and their indices.

        Contacts that equality constraints tie do not take part, nor do limits that only their drift closes.
        """
        part = np.flatnonzero(~kept.tie(closed.contacts))
        closed, gamma = closed.select(part), gamma[part]
        constraints = self.bilateral_rows(data, kept.calm(closed.jacobian, gamma))
        if constraints is not None:
            limits = closed.contacts.geoms[:, 0] < 0
            given = drifting(self.metric(data), closed.jacobian, constraints, data.qvel)
            acting = np.flatnonzero(~(limits & given))
            closed, part = closed.select(acting), part[acting]
        return closed._replace(bilateral=constraints), part

    def _collide(
        self,
        collider: Collider,
        data: mujoco.MjData,
        closed: Closed,
        gamma: np.ndarray,
        approach: np.ndarray,
        events: list[ImpactEvent],
    ) -> np.ndarray:
        """Return the velocity after all collisions, (nv,), and append these."""
        self._work.begin()
        return collider.collide(
            self.metric(data),
            closed,
            data.qvel.copy(),
            approach=approach,
            rounding=np.full(len(gamma), ROUNDING * np.abs(gamma).max(initial=0.0)),
            opening=OPENING * self.rest_speed,
            time=data.time,
            qpos=data.qpos,
            events=events,
            work=self._work if isinstance(collider.law, Coulomb) else None,
        )

    def metric(self, data: mujoco.MjData) -> KineticMetric:
        """Return the kinetic metric; joints that damping all but locks have the integrator's inertia ``M + h D``."""
        metric, added = kinetic_metric(self.model, data), added_inertia(self.model)
        return metric if added is None else KineticMetric(metric.mass_matrix + np.diag(added))

    def bilateral_rows(self, data: mujoco.MjData, calm: np.ndarray) -> np.ndarray | None:
        """Return rows of the constraints that keep their velocity, (k, nv), see `equality_constraints.bilateral_rows`.

        Which of nearly redundant rows count depends on the metric, which is that of the collision.
        """
        added = added_inertia(self.model)
        with nullcontext() if added is None else with_locked_joints(self.model, data, added):
            return bilateral_rows(self.model, data, self.bilateral, calm=calm)

    def _without_restitution(
        self,
        data: mujoco.MjData,
        closed: Closed,
        gamma: np.ndarray,
        approach: np.ndarray,
        events: list[ImpactEvent],
    ) -> np.ndarray | None:
        """Return the velocity after the collisions without restitution, (nv,), and append these.

        It is None if the law has no restitution anyway, or if friction or constraints jam bodies even without it.

        Successive collisions with restitution are not the same as those without: one of the former can have no solution
        although each of the latter has one.
        """
        law, last = self.collider.law, self.collider.last_law
        if _is_same(law, last):
            return None
        try:
            return self._collide(replace(self.collider, law=last), data, closed, gamma, approach, events)
        except _UNSOLVED:
            return None

    def _approach(
        self, data: mujoco.MjData, closed: Closed, gamma: np.ndarray, before: np.ndarray | None
    ) -> np.ndarray:
        """Return the closing speeds above which contacts collide, (h,), see `pressed_contacts`."""
        row = first_rows(self.model, data)
        depth, last = data.efc_margin[row] - data.efc_pos[row], closed.jacobian @ data.qacc_warmstart
        given, geoms = (self.model.opt.timestep, self.rest_speed), closed.contacts.geoms
        approach = np.array([approach_speed(*each, *given) for each in zip(gamma, last, depth, strict=True)])
        still = True if closed.drift is None else closed.drift == 0.0
        deep = np.flatnonzero((approach > self.rest_speed) & (geoms[:, 0] >= 0) & still)
        if not len(deep):
            return approach
        if before is None:
            before = pairs_before(self.model, data, self._earlier.data)
        before = np.sort(before, axis=1)
        approach[[i for i in deep if not (before == geoms[i]).all(axis=1).any()]] = self.rest_speed
        return approach

    def closed(self, data: mujoco.MjData) -> Closed:
        """Return the contacts and limits that MuJoCo's solver acts on now, as closed contacts without constraints."""
        contacts, jacobian = self.active(data)
        found = None
        if self.friction and data.ncon:
            contacts = _on_bodies(self.model, contacts)
            found = active_friction(self.model, data, contacts.select(contacts.geoms[:, 0] >= 0), self.surfaces)
        drift = None if self.surfaces is None else self.surfaces.drift(data, contacts)
        return Closed(contacts, jacobian, None, drift, friction=None if found is None else Friction(*found))

    def active(self, data: mujoco.MjData) -> tuple[Contacts, np.ndarray]:
        """Return the contacts and limits that MuJoCo's solver acts on now, and their gradients, (h, nv)."""
        contacts = active_contacts(self.model, data, self.names)
        jacobian = gap_gradients(self.model, data, contacts)
        if not data.nl:
            return contacts, jacobian
        limits = self.limits.read(data)
        return contacts.followed_by(self.limits.contacts(data, limits)), np.vstack([jacobian, limits.jacobian])


def _on_bodies(model: mujoco.MjModel, contacts: Contacts) -> Contacts:
    """Put contacts with bodies without degrees of freedom, such as mocap bodies, on the surface of the other body.

    MuJoCo has them in the middle of the overlap, where the lever of friction on a ball is too short. Contacts of two
    bodies that move stay there: impulses at two different points would change the angular momentum.
    """
    still = (model.body_treeid[model.geom_bodyid[contacts.geoms]] < 0).astype(float)  # limits: the same on both sides
    shift = 0.5 * contacts.gap * (still[:, 0] - still[:, 1])
    return replace(contacts, position=contacts.position + shift[:, None] * contacts.normal)


def _is_same(law: Law, last: Law) -> bool:
    """Return whether a law is the same as the one without restitution, `last`."""
    if law.normal_law.common_coefficient != 0.0 or isinstance(law, Coulomb) != isinstance(last, Coulomb):
        return False
    return not (isinstance(law, Coulomb) and isinstance(last, Coulomb)) or replace(law, law=last.law) == last
