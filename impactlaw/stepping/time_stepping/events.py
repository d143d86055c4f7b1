"""What the contacts of a step have done: impulses, and collisions as they were met, resolved when asked for."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
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

Known = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Groups, keys, coefficients of friction and impulses of a step, and its `turns`."""
Metric = tuple[np.ndarray, np.ndarray]
"""L and ``1 / D`` of the mass matrix of a step, ``M_h = L^T D L``."""


@dataclass(frozen=True, eq=False)
class CollisionRecord:
    """What collides in a step: everything that the event is made of, copied.

    The event is the collision by itself, at the velocity of the start of the step and without the other forces of the
    step: ``v+ = v- + M_h^-1 J^T Lambda`` reaches the same contact velocities as the step. Equality constraints that
    collisions may violate, such as servos, are among these forces.
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
        collision = self.seen.collision(groups, self.velocity, contacts.labels, friction=True)
        impact = self._impact(collision, groups)
        projected = self.share < 1.0 or impact.target_contact_velocity is None
        return (ImpactEvent(self.time, contacts, impact, self.qpos, projected=projected),)

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
                return Impact.observed(collision, impact.post_velocity)
            return impact
        targets = target, self.sliding[self.seen.tangential(groups)[0]]
        problem = cone_problem(collision, *targets, exact=self.exact)
        answer = solve_cones(problem)
        if answer.status is not Status.SOLVED:  # the step went to the nearest point
            with suppress(SolverError):
                return FrictionImpact.observed(collision, self.after)
        more = {"restitution_scale": self.share, "exact": self.exact, "cones": problem}
        return FrictionImpact.of_cones(collision, answer.impulse, answer.jump, targets, **more)


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
