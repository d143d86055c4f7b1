"""What the contacts of a step have done: impulses, and collisions as they were met, resolved when asked for."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from impactlaw.errors import SolverError, UnsolvableLawError
from impactlaw.laws import Target
from impactlaw.laws.base import jump_problem
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact, cone_problem
from impactlaw.mechanics.impact import Impact
from impactlaw.solvers import solve_with_jump
from impactlaw.solvers.friction.solve import solve_cones
from impactlaw.solvers.problem import Status
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.time_stepping.problem.seen import Seen, in_order
from impactlaw.stepping.time_stepping.tolerances import DRIVEN, is_met

Known = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Groups, keys, coefficients of friction and impulses of a step, and its `turns`."""
Metric = tuple[np.ndarray, np.ndarray]
"""L and ``1 / D`` of the mass matrix of a step, ``M_h = L^T D L``."""
_ROUNDING = 1e-12  # part of the energy of all


@dataclass(frozen=True, eq=False)
class CollisionRecord:
    """What collides in a step: everything that the event is made of, copied.

    The event is the collision by itself, at the velocity of the start of the step and without the other forces of the
    step: ``v+ = v- + M_h^-1 J^T Lambda`` reaches the same contact velocities as the step. Equality constraints that
    collisions may violate, such as servos, are among these forces. So are those that move against themselves and would
    drive the collision if they kept that, or lock what collides: in the step they give way, see
    `problem.solution.driven`.
    """

    seen: Seen  # contacts, rows and inertia of the middle of the step
    collides: np.ndarray  # the groups that do, bool (g,)
    pushed: np.ndarray  # those with an impulse, bool (g,)
    time: float  # of the middle of the step, s
    qpos: np.ndarray  # configuration there, (nq,)
    velocity: np.ndarray  # v-, (nv,)
    after: np.ndarray  # velocity at the end of the step, (nv,)
    target: np.ndarray  # ``gamma^h`` of groups, (g,)
    sliding: np.ndarray  # sliding velocities aimed at, what is left of them, (n,)
    exact: bool  # exact Coulomb friction, or its convex relaxation
    # of the law's restitution that was left so that no energy is created, in [0, 1]; the least one, if there are
    # several
    share: float

    def resolved(self) -> tuple[ImpactEvent, ...]:
        """Return the collision as an event."""
        return self._events

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        groups = in_order(self.seen.rows, self.seen.reached(self.collides, self.pushed))
        contacts = self.seen.contacts(groups)
        impact, _ = beside_constraints(self.seen, groups, lambda acts: self._beside(acts, groups, contacts.labels))
        projected = self.share < 1.0 or impact.target_contact_velocity is None
        return (ImpactEvent(self.time, contacts, impact, self.qpos, projected=projected),)

    def _beside(self, acts: np.ndarray, groups: np.ndarray, labels: tuple[str, ...]) -> tuple[Impact, bool | None]:
        """Do what `beside_constraints` asks for."""
        collision = self.seen.collision(groups, self.velocity, labels, friction=True, acts=acts)
        impact = self._impact(collision, groups)
        if np.array_equal(impact.post_velocity, self.after):  # no impulses meet the law
            return impact, self._is_met(collision, groups)  # though those of the step may
        return impact, None

    def _is_met(self, collision: Collision, groups: np.ndarray) -> bool:
        """Return whether the step has met the law of the contacts that collide."""
        missed = (self.target[groups] - collision.contact_velocity_after(self.after))[self.collides[groups]]
        return is_met(missed.max(initial=0.0), np.abs(collision.pre_contact_velocity).max())

    def _impact(self, collision: Collision, groups: np.ndarray) -> Impact:
        target = np.where(self.collides, self.target, 0.0)[groups]
        if collision.friction is None:
            problem = jump_problem(collision, Target(target))
            try:
                answer = solve_with_jump(problem, collision.labels, shared=False)
            except (UnsolvableLawError, SolverError):  # the step went to the nearest point
                return Impact.observed(collision, self.after)
            impact = Impact.solved(collision, problem, answer, target)
            if self.share < 1.0:  # not the law's own outcome
                return replace(impact, target_contact_velocity=None)
            return impact
        targets = target, self.sliding[self.seen.tangential(groups)[0]]
        problem = cone_problem(collision, *targets, exact=self.exact)
        answer = solve_cones(problem)
        if answer.status is not Status.SOLVED:  # the step went to the nearest point
            with suppress(SolverError):
                return FrictionImpact.observed(collision, self.after)
            targets = None
        more = {"restitution_scale": self.share, "exact": self.exact, "cones": problem}
        return FrictionImpact.of_cones(collision, answer.impulse, answer.jump, targets, **more)


def beside_constraints(
    seen: Seen, groups: np.ndarray, resolve: Callable[[np.ndarray], tuple[Impact, bool | None]]
) -> tuple[Impact, np.ndarray]:
    """Return the impact beside all constraints; where they drive or lock it, beside those that the step holds, or none.

    And return which of them act in it, bool (g,).

    Args:
        seen: what collides.
        groups: the contacts, int (h,).
        resolve: returns the impact beside constraints that act, bool (g,), and whether they lock it; None if that is
            to be seen from how they move.
    """
    rows, acts = seen.rows, seen.kept
    impact, locked = resolve(acts)
    if impact.collision.bilateral_jacobian is None:
        return impact, acts
    held, (label, island) = rows.compliance[rows.first] < rows.amounts[1], seen.islands()
    for may in (held, np.zeros_like(held)):
        driven = _driven_islands(impact, label[groups], island)
        if locked is not None:
            driven[:-1] = locked
        if not driven.any():
            break
        acts = acts & (may | ~driven[label])
        impact, locked = resolve(acts)
    return impact, acts


def _driven_islands(impact: Impact, label: np.ndarray, island: np.ndarray) -> np.ndarray:
    """Return in which islands equality constraints drive a collision by their motion, bool (islands + 1,), False last.

    There they, and also they and its contacts, add more than `DRIVEN` of the energy with which its fastest contact
    collides, in the motion that they allow.

    Args:
        impact: beside the constraints.
        label: the islands of its contacts, -1 for one that cannot move, (h,).
        island: those of degrees of freedom, -1 for those in none, (nv,).
    """
    c, many = impact.collision, max(label.max(initial=-1), island.max(initial=-1)) + 1
    of_contacts, impulse = impact.found_impulse * impact.mean_contact_velocity, c.jacobian.T @ impact.found_impulse
    if isinstance(impact, FrictionImpact) and c.friction is not None:
        of_contacts, impulse = impact.work_of_each, impulse + c.friction.jacobian.T @ impact.friction_impulse
    own = c.mass_matrix @ (impact.post_velocity - c.pre_velocity) - impulse
    work = np.bincount(island + 1, 0.5 * own * (c.pre_velocity + impact.post_velocity), many + 1)
    total = work + np.bincount(label + 1, of_contacts, many + 1)
    approach = c.whitened_jacobian @ c.whitened_velocity + (0.0 if c.surface_velocity is None else c.surface_velocity)
    energy = np.full(many + 1, _ROUNDING * c.kinetic_energy)
    lengths = np.where(c.gradient_norms > 0.0, c.gradient_norms, np.inf)
    np.maximum.at(energy, label + 1, 0.5 * (approach / lengths) ** 2)
    driven = np.minimum(work, total) > DRIVEN * energy
    return np.append(driven[1:], False)


@dataclass(frozen=True, eq=False)
class StepImpulses:
    """What contact does in a step."""

    impulse: np.ndarray  # of all rows, in units of the problem, (n,)
    velocity: np.ndarray  # after it, (nv,)
    shift: np.ndarray  # velocity that opens overlaps beside it, (nv,), or (0,)
    shortfall: float  # largest amount by which a contact velocity misses its target, m/s or rad/s
    fastest: float  # largest velocity of a row, m/s or rad/s
    residual: float  # natural map that is left, of friction too, relative to the largest velocity
    work: float  # of contact, J
    rounding: float  # what of it is rounding, J
    collisions: tuple[CollisionRecord, ...]  # of the step, one after another
    # whether restitution is lost: contacts that are hit only through others were not left for a phase of their own,
    # bodies jam, or there was no work left to find how much of it creates no energy
    later: bool
    reached: np.ndarray  # targets of groups, NaN if collisions were one after another, (g,)
    sliding: np.ndarray  # sliding velocities aimed at, (n,)
