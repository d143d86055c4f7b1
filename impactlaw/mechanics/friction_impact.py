"""An impact with friction: impulses in friction cones, and checks that need only the outcome."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import InvalidCollisionError, SolverError
from impactlaw.mechanics.admissible.violations import Violations, measured
from impactlaw.mechanics.collision import Collision, checked
from impactlaw.mechanics.friction import Friction
from impactlaw.mechanics.impact import Impact
from impactlaw.solvers import Answer, Problem, beyond_rounding  # noqa: F401  (types of inherited fields)
from impactlaw.solvers.friction.problem import ConeProblem, project
from impactlaw.solvers.friction.solve import solve_cones
from impactlaw.solvers.problem import Status


@dataclass(frozen=True, eq=False)
class FrictionImpact(Impact):
    """Velocity after a collision with friction, ``M (v+ - v-) = J^T Lambda + J_t^T Lambda_t``.

    The attributes of `Impact` keep their meaning for the normal directions. Further attributes:

    Attributes:
        friction_impulse: ``Lambda_t``, shape (k,), N s or N m s, one entry per row of the collision's friction.
        target_sliding_velocity: ``-e_t gamma_t-`` of the law, shape (k,); None for an observed outcome.
        restitution_scale: s in [0, 1], by which the law scaled its restitution so that no energy is created; the least
            s, if groups of contacts that do not influence each other have different ones.
        exact: whether friction is exact Coulomb friction, or else its convex relaxation.
        cones: a cone problem of this collision, if one has been made already, to save work.
    """

    friction_impulse: np.ndarray = field(kw_only=True)
    target_sliding_velocity: np.ndarray | None = field(default=None, kw_only=True)
    restitution_scale: float = field(default=1.0, kw_only=True)
    exact: bool = field(default=True, kw_only=True)
    cones: ConeProblem | None = field(default=None, kw_only=True, repr=False)

    @classmethod
    def of_cones(
        cls,
        collision: Collision,
        impulse: np.ndarray,
        jump: np.ndarray,
        targets: tuple[np.ndarray, np.ndarray] | None = None,
        **more: Any,
    ) -> FrictionImpact:
        """Return the impact for an impulse of the cone problem, (h + k,), and its jump ``R^T (v+ - v-)``, (nv,).

        ``targets`` are the normal and the sliding velocities that the law aims at; ``more`` are further attributes.
        """
        friction, h = _friction(collision), len(collision.labels)
        parts = np.empty(len(impulse))
        parts[collision.cone_rows.order] = impulse
        normal, sliding = (None, None) if targets is None else targets
        return cls(
            collision,
            collision.pre_velocity + collision.metric.unwhiten(jump),
            parts[:h],
            normal,
            friction_impulse=parts[h:] * friction.coefficient,
            target_sliding_velocity=sliding,
            **more,
        )

    @classmethod
    def observed(cls, collision: Collision, post_velocity: ArrayLike) -> FrictionImpact:
        """Audit an outcome with friction from any source, see `Impact.observed`.

        The impulse is one in the friction cones whose velocity jump is nearest to the observed jump; it is not unique
        where contacts are redundant.

        Raises:
            InvalidCollisionError: post_velocity does not fit, or the collision has no friction.
            SolverError: no nearest impulse was found.
        """
        v, rows = checked(collision).velocity(post_velocity, "post_velocity"), cone_gradients(collision)
        jump = collision.metric.whiten(v - collision.pre_velocity)
        answer = solve_cones(ConeProblem(rows, -(rows @ jump), collision.cone_rows.sizes, exact=False))
        if answer.status is not Status.SOLVED:
            raise SolverError(f"no impulse nearest to this velocity was found: residual {answer.residual:.1e} sqrt(J)")
        return replace(cls.of_cones(collision, answer.impulse, jump), post_velocity=v)

    @property
    def cone_impulse(self) -> np.ndarray:
        """Impulse of the cone problem, (n,): contact by contact, normal part first, friction divided by mu."""
        along = self.friction_impulse / _friction(self.collision).coefficient
        return np.concatenate([self.impulse, along])[self.collision.cone_rows.order]

    @property
    def pre_sliding_velocity(self) -> np.ndarray:
        """``gamma_t- = J_t v- + w_t-``, shape (k,), m/s or rad/s."""
        return self.collision.pre_sliding_velocity

    @cached_property
    def post_sliding_velocity(self) -> np.ndarray:
        """``gamma_t+ = J_t v+ + w_t+``, shape (k,), m/s or rad/s."""
        friction = _friction(self.collision)
        return friction.jacobian @ self.post_velocity + friction.post_surface_velocity

    @cached_property
    def surface_work(self) -> float:
        """``T+ - T-`` less `work`, J: the work of moving surfaces and of moving bilateral constraints."""
        return self.energy_change - self.work

    @cached_property
    def work(self) -> float:
        """``Lambda^T gamma_bar + Lambda_t^T gamma_bar_t``, J: the work of contact impulses; positive creates energy."""
        sliding = 0.5 * (self.pre_sliding_velocity + self.post_sliding_velocity)
        return float(self.impulse @ self.mean_contact_velocity + self.friction_impulse @ sliding)

    @cached_property
    def work_after_jump(self) -> float:
        """`work` computed with w+ and w_t+ from the start for surfaces whose velocity jumps, J.

        Friction opposes sliding relative to w_t+, so with E = 0 this work is never positive. `work` itself can be: a
        rod that slides on a table and is struck by it may slide back a little.
        """
        return float(self.work_of_each.sum())

    @cached_property
    def work_of_each(self) -> np.ndarray:
        """The contribution of each contact to `work_after_jump`, shape (h,), J."""
        c, friction, mean = self.collision, _friction(self.collision), self.mean_contact_velocity
        if c.surface_jump is not None:
            mean = mean + 0.5 * c.surface_jump
        sliding = 0.5 * (self.pre_sliding_velocity + self.post_sliding_velocity + friction.surface_jump)
        rubbing = np.bincount(friction.contact, self.friction_impulse * sliding, len(c.labels))
        return self.impulse * mean + rubbing

    @cached_property
    def violations(self) -> Violations:
        """Violations as in `Impact`, with friction cones for the impulses and `work_after_jump` as the energy gain.

        Their scale is the sliding speed of moving surfaces if that is larger than ``|v-|``.
        """
        c, gain = self.collision, self.work_after_jump
        speed = max(c.pre_speed, self._problem.scale)
        return measured(c, self.whitened_jump, self.post_contact_velocity, self._cone_error, gain, speed)

    @cached_property
    def residual(self) -> float:
        """Certificate, relative to the speed: the largest error of momentum, cones and complementarity of the law.

        The complementarity, checked if the outcome is that of a law, is measured by the length of the natural map
        ``Lambda - P_K(Lambda - u - |u_t| e_n)`` in units of the kinetic metric, with
        ``u = (gamma+ - gamma^h, mu (gamma_t+ + e_t gamma_t-))`` contact by contact (for exact friction; the relaxation
        has no ``|u_t|``).
        """
        problem, friction = self._problem, _friction(self.collision)
        error = self._cone_error
        if self.target_contact_velocity is not None and self.target_sliding_velocity is not None:
            normal = self.post_contact_velocity - self.target_contact_velocity
            sliding = friction.coefficient * (self.post_sliding_velocity - self.target_sliding_velocity)
            by_contact = np.concatenate([normal, sliding])[self.collision.cone_rows.order]
            u = problem.scaled(by_contact) / problem.lengths[:, None] ** 2
            error = max(error, problem.residual(self._scaled_impulse, u))
        speed = max(self._speed, problem.scale)
        return error / speed if speed > 0 else error

    @cached_property
    def _problem(self) -> ConeProblem:
        """The cones of this collision, with the velocity before as the offset."""
        return cone_problem(self.collision, exact=self.exact, known=self.cones)

    @cached_property
    def _scaled_impulse(self) -> np.ndarray:
        return self._problem.scaled(self.cone_impulse)

    @property
    def _cone_error(self) -> float:
        """The larger of two distances, sqrt(J): of the impulses from their cones, and of the jump from their effect."""
        x = self._scaled_impulse
        gap = float(np.linalg.norm(self.whitened_jump - x.reshape(-1) @ self._problem.rows))
        imbalance = beyond_rounding(gap, float(np.abs(x).sum()), self._speed)
        return max(imbalance, float(np.linalg.norm(x - project(x))))


def cone_gradients(collision: Collision) -> np.ndarray:
    """Return the rows of the cone problem, contact by contact, with friction rows multiplied by mu, (h + k, nv)."""
    friction = _friction(collision)
    tangential = collision.whitened_friction * friction.coefficient[:, None]
    return np.vstack([collision.whitened_jacobian, tangential])[collision.cone_rows.order]


def cone_problem(
    collision: Collision,
    normal: np.ndarray | float = 0.0,
    sliding: np.ndarray | float = 0.0,
    *,
    exact: bool = True,
    known: ConeProblem | None = None,
) -> ConeProblem:
    """Return the cone problem for target normal velocities, (h,), and target sliding velocities, (k,).

    ``u_n = gamma+ - normal``, ``u_t = mu (gamma_t+ - sliding)``. ``known``, an earlier problem of the same contacts,
    saves half the work.
    """
    friction = _friction(collision)
    order, sizes = collision.cone_rows
    bound = collision.pre_contact_velocity
    if collision.surface_jump is not None:
        bound = bound + collision.surface_jump
    along = collision.pre_sliding_velocity + friction.surface_jump
    offset = np.concatenate([bound - normal, (along - sliding) * friction.coefficient])[order]
    if known is not None:
        return known.starting(offset, collision.pre_speed)
    return ConeProblem(cone_gradients(collision), offset, sizes, exact=exact, speed=collision.pre_speed)


def _friction(collision: Collision) -> Friction:
    if collision.friction is None:
        raise InvalidCollisionError("the collision has no friction: Collision(..., friction=Friction(...))")
    return collision.friction
