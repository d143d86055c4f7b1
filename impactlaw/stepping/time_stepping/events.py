"""The collision of a step, kept as it was met, and resolved as an event when somebody asks for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from impactlaw.collision import Collision
from impactlaw.contacts import Contacts
from impactlaw.errors import SolverError, UnsolvableLawError
from impactlaw.events import ImpactEvent
from impactlaw.friction_impact import FrictionImpact, cone_problem
from impactlaw.impact import Impact
from impactlaw.laws import MaximalDissipation, Target
from impactlaw.laws.base import jump_problem
from impactlaw.solvers import solve_with_jump
from impactlaw.solvers.cone_solve import solve_cones
from impactlaw.stepping.time_stepping.dense import mass_matrix
from impactlaw.stepping.time_stepping.seen import SeenRows


@dataclass(frozen=True, eq=False)
class CollisionRecord:
    """What collides in a step: everything that the event is made of, copied.

    The event is the collision by itself, at the velocity of the start of the step and without the other forces of the
    step: ``v+ = v- + M_h^-1 J^T Lambda`` reaches the same contact velocities as the step.

    Attributes:
        model: the scene, for the sparsity of its mass matrix.
        time: of the middle of the step, s.
        qpos: configuration there, (nq,).
        velocity: v-, (nv,).
        factor: L of ``M_h = L^T D L``.
        inverse: ``1 / D``, (nv,).
        contacts: that collide, and those that they reach.
        rows: their gradients and velocities.
        target: ``gamma^h``, (h,).
        sliding: sliding velocities aimed at, (k,).
        exact: exact Coulomb friction, or its convex relaxation.
    """

    model: mujoco.MjModel
    time: float
    qpos: np.ndarray
    velocity: np.ndarray
    factor: np.ndarray
    inverse: np.ndarray
    contacts: Contacts
    rows: SeenRows
    target: np.ndarray
    sliding: np.ndarray
    exact: bool

    def resolved(self) -> tuple[ImpactEvent, ...]:
        """Return the collision as an event."""
        return self._events

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        return (ImpactEvent(self.time, self.contacts, self._impact(), self.qpos),)

    @cached_property
    def collision(self) -> Collision:
        """What collides."""
        model = self.model
        M = mass_matrix(self.factor, model.M_rownnz, model.M_rowadr, model.M_colind, self.inverse)
        return self.rows.collision(M, self.velocity, self.contacts.labels)

    def _impact(self) -> Impact:
        collision = self.collision
        if collision.friction is None:
            problem = jump_problem(collision, Target(self.target))
            try:
                answer = solve_with_jump(problem, collision.labels, shared=False)
            except (UnsolvableLawError, SolverError):  # the step went to the nearest point; the event shows E = 0
                return MaximalDissipation().resolve(collision)
            return Impact.solved(collision, problem, answer, self.target)
        targets = self.target, self.sliding
        problem = cone_problem(collision, *targets, exact=self.exact)
        answer = solve_cones(problem)
        return FrictionImpact.of_cones(
            collision, answer.impulse, answer.jump, targets, exact=self.exact, problem=problem
        )
