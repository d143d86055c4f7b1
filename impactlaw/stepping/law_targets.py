"""The contact velocities that a law asks of the contacts that collide in a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactlaw.errors import SolverError, UnfinishedStepError, UnsolvableLawError
from impactlaw.laws import Coulomb, Law, Poisson, Routh
from impactlaw.laws.base import aim
from impactlaw.laws.friction.groups import groups_of, ties_of
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.impact import Impact
from impactlaw.solvers.friction.problem import ConeProblem
from impactlaw.solvers.friction.solve import Effort


class LawTargets:
    """The contact velocities ``gamma^h`` that a law aims at, for the problem of a step.

    This works for any law. A law with a target, such as ``gamma^h = -E gamma-``, gives that target. A law with its own
    rule for impulses, such as Poisson's two phases, gives the contact velocities that it leads to without friction;
    these solve ``0 <= Lambda  ⊥  gamma+ - gamma^h >= 0``, because the law's own impulses do. A rule that includes
    friction, such as Routh's, also gives the final sliding velocities.

    Attributes:
        restitution: e if the law has the same e for every contact (then no more needs to be known); else None.
        alone: whether the target of a contact depends on the velocity of that contact only.
    """

    def __init__(self, law: Law, *, exact: bool = True):
        self.law = law.normal_law
        self.restitution = self.law.common_coefficient
        self.alone = self.law.per_contact
        self.rule = law if isinstance(law, Routh) else None
        if isinstance(self.law, Poisson):
            self.rule = law if isinstance(law, Coulomb) else Coulomb(law, cone="exact" if exact else "convex")

    def of_each(self, labels: Sequence[str], velocity: np.ndarray) -> np.ndarray:
        """Return ``gamma^h`` of contacts, (k,), from their labels and ``gamma-``, (k,); only valid if `alone`."""
        unit = np.eye(len(velocity))
        return np.asarray(aim(self.law, Collision(unit, unit, velocity, labels=tuple(labels))).contact_velocity)

    def rules(self, collision: Collision) -> bool:
        """Return whether the law has its own rule for the impulses of a collision with friction."""
        return self.rule is not None and collision.friction is not None

    def with_friction(self, collision: Collision, effort: Effort | None = None) -> tuple[np.ndarray, np.ndarray] | None:
        """Return ``gamma^h``, (k,), and final sliding velocities of a rule with friction.

        The rule leaves out friction that no normal impulse can cause, but the velocities are those of all rows. Return
        None if it finds no impulses, within an effort.
        """
        impact, friction = self.outcome(collision, effort), collision.friction
        if impact is None or friction is None:
            return None
        sliding = friction.jacobian @ impact.post_velocity + friction.post_surface_velocity
        return impact.post_contact_velocity, sliding

    def of_all(self, collision: Collision) -> np.ndarray | None:
        """Return ``gamma^h``, (k,), of all contacts of a collision without friction; None if there is no solution."""
        try:
            if self.law.has_target:
                return np.asarray(aim(self.law, collision).contact_velocity, dtype=float)
            return self.law.resolve(collision).post_contact_velocity
        except (UnsolvableLawError, SolverError):
            return None

    def outcome(self, collision: Collision, effort: Effort | None = None) -> Impact | None:
        """Return the impact of the rule with friction in it, or else of the law.

        Return None where it has no solution, or none is found within an effort.
        """
        law = self.rule if self.rule is not None and self.rules(collision) else self.law
        try:
            return law.resolve(collision, effort=effort) if isinstance(law, Coulomb) else law.resolve(collision)
        except (UnsolvableLawError, SolverError, UnfinishedStepError):
            return None

    def couples(self, collision: Collision) -> bool:
        """Return whether the law couples contacts that do not influence each other through the mass matrix."""
        ties, h = ties_of(self.law, collision), len(collision.labels)
        if ties is None:
            return False
        problem = ConeProblem(collision.dense_gradients, np.zeros(h), np.ones(h, dtype=int))
        return len(groups_of(problem, ties)) < len(groups_of(problem, None))
