"""The collision of a step, kept as it was met, and resolved as an event when somebody asks for it."""

from __future__ import annotations

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
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.time_stepping.problem.seen import Seen, in_order


@dataclass(frozen=True, eq=False)
class CollisionRecord:
    """What collides in a step: everything that the event is made of, copied.

    The event is the collision by itself, at the velocity of the start of the step and without the other forces of the
    step: ``v+ = v- + M_h^-1 J^T Lambda`` reaches the same contact velocities as the step.

    Attributes:
        seen: contacts, rows and inertia of the middle of the step.
        collides: the groups that do, bool (g,).
        pushed: those with an impulse, bool (g,).
        time: of the middle of the step, s.
        qpos: configuration there, (nq,).
        velocity: v-, (nv,).
        after: velocity at the end of the step, (nv,).
        target: ``gamma^h`` of groups, (g,).
        sliding: sliding velocities aimed at, (n,).
        exact: exact Coulomb friction, or its convex relaxation.
        share: of the law's restitution that was left so that no energy is created, in [0, 1].
    """

    seen: Seen
    collides: np.ndarray
    pushed: np.ndarray
    time: float
    qpos: np.ndarray
    velocity: np.ndarray
    after: np.ndarray
    target: np.ndarray
    sliding: np.ndarray
    exact: bool
    share: float

    def resolved(self) -> tuple[ImpactEvent, ...]:
        """Return the collision as an event."""
        return self._events

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        groups = in_order(self.seen.rows, self.seen.reached(self.collides, self.pushed))
        contacts = self.seen.contacts(groups)
        collision = self.seen.collision(groups, self.velocity, contacts.labels, friction=True)
        return (ImpactEvent(self.time, contacts, self._impact(collision, groups), self.qpos),)

    def _impact(self, collision: Collision, groups: np.ndarray) -> Impact:
        target = np.where(self.collides, self.target, 0.0)[groups]
        if collision.friction is None:
            problem = jump_problem(collision, Target(target))
            try:
                answer = solve_with_jump(problem, collision.labels, shared=False)
            except (UnsolvableLawError, SolverError):  # the step went to the nearest point
                return Impact.observed(collision, self.after)
            return Impact.solved(collision, problem, answer, target)
        targets = target, self.sliding[self.seen.tangential(groups)[0]]
        problem = cone_problem(collision, *targets, exact=self.exact)
        answer = solve_cones(problem)
        return FrictionImpact.of_cones(
            collision, answer.impulse, answer.jump, targets, scale=self.share, exact=self.exact, problem=problem
        )
