"""An impact: the outcome of a collision, its characteristic entities, and the checks that need only the outcome."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.mechanics.admissible.violations import Violations, imbalance, larger_speed, measured, pushed
from impactlaw.mechanics.collision import Collision, checked
from impactlaw.mechanics.tolerances import FIXED, SIGNIFICANT
from impactlaw.solvers import Answer, Problem, nonnegative_combination, share


@dataclass(frozen=True, eq=False)
class Impact:
    """The velocity after a collision and the impulse that causes it, ``M (v+ - v-) = J^T Lambda``.

    All quantities are defined as in Aeberhard and Glocker, "Perfect multi-contact collisions".

    Attributes:
        collision: the collision.
        post_velocity: ``v+``, shape (nv,).
        found_impulse: an impulse that leads to v+, shape (h,), N s.
        target_contact_velocity: ``gamma^h`` of the law, shape (h,), m/s; None for an observed outcome.
        least_impulse: a part of the impulse that the law fixes beforehand, shape (h,), N s; None if it is 0. Under
            Poisson's law it is ``(1 + e) Lambda_C``, and the impulse beyond it is of least norm.
        compression: the first phase of an impact that has two phases; else None.
        problem: if given, redundant contacts do not share the impulse of `answer`, its solution, until `impulse` is
            asked for.
        answer: see `problem`.
    """

    collision: Collision
    post_velocity: np.ndarray
    found_impulse: np.ndarray
    target_contact_velocity: np.ndarray | None = None
    least_impulse: np.ndarray | None = field(default=None, kw_only=True)
    compression: Impact | None = field(default=None, kw_only=True)
    problem: Problem | None = field(default=None, kw_only=True, repr=False)
    answer: Answer | None = field(default=None, kw_only=True, repr=False)

    @classmethod
    def solved(cls, collision: Collision, problem: Problem, answer: Answer, target: np.ndarray) -> Impact:
        """Return the impact that follows from the answer to the problem of a law."""
        v = collision.pre_velocity + collision.metric.unwhiten(answer.jump)
        return cls(collision, v, answer.impulse, target, problem=problem, answer=answer)

    @cached_property
    def impulse(self) -> np.ndarray:
        """``Lambda``, shape (h,), N s; of least Euclidean norm where contacts are redundant."""
        if self.problem is None or self.answer is None:
            return self.found_impulse
        return share(self.problem, self.answer).impulse

    @classmethod
    def observed(cls, collision: Collision, post_velocity: ArrayLike) -> Impact:
        """Audit an outcome from any source: a measurement, another engine, MuJoCo itself.

        The impulse is the one of least norm among those whose velocity jump is nearest to the observed jump in the
        kinetic metric, ``min |v+ - v- - M^-1 J^T Lambda|, Lambda >= 0``; the remaining distance is
        ``violations.kinetic``. Friction of the collision is not considered, so friction impulses count as a kinetic
        violation; `FrictionImpact.observed` takes it into account.

        Raises:
            InvalidCollisionError: the argument is not a `Collision`, or post_velocity has the wrong shape or entries
                that are not finite.
        """
        v = checked(collision).velocity(post_velocity, "post_velocity")
        jump = collision.metric.whiten(v - collision.pre_velocity)
        return cls(collision, v, nonnegative_combination(collision.whitened_jacobian, jump))

    @cached_property
    def whitened_jump(self) -> np.ndarray:
        """``R^T (v+ - v-)``, shape (nv,)."""
        return self.collision.metric.whiten(self.post_velocity - self.collision.pre_velocity)

    @cached_property
    def post_contact_velocity(self) -> np.ndarray:
        """``gamma+ = J v+ + w+``, shape (h,), m/s."""
        return self.collision.contact_velocity_after(self.post_velocity)

    @cached_property
    def mean_contact_velocity(self) -> np.ndarray:
        """``(gamma- + gamma+) / 2``, shape (h,), m/s."""
        return 0.5 * (self.collision.pre_contact_velocity + self.post_contact_velocity)

    @cached_property
    def intensity(self) -> float:
        """``rho = |v+ - v-|`` in the kinetic metric, sqrt(J)."""
        return float(np.linalg.norm(self.whitened_jump))

    @cached_property
    def induced_impulse(self) -> float:
        """``|Lambda|_1``, N s: the impulse of the one-point collision on the induced contact."""
        return float(np.abs(self.impulse).sum())

    @cached_property
    def topology(self) -> np.ndarray:
        """``alpha = Lambda / |Lambda|_1``, shape (h,); zeros if there is no impulse."""
        total = self.induced_impulse
        return self.impulse / total if total > 0 else np.zeros_like(self.impulse)

    @cached_property
    def induced_gradient(self) -> np.ndarray:
        """``alpha^T J``, shape (nv,): gradient of the induced contact ``g_alpha = sum alpha_i g_i``."""
        return self.topology @ self.collision.jacobian

    @cached_property
    def energy_change(self) -> float:
        """``T+ - T-``, J; equals ``Lambda^T gamma_bar + surface_work`` when the impulses explain the jump."""
        return float(self.whitened_jump @ (self.collision.whitened_velocity + 0.5 * self.whitened_jump))

    @cached_property
    def surface_work(self) -> float:
        """``-Lambda^T (w- + w+) / 2``, J: the work of moving surfaces, and of bilateral constraints if they move."""
        rates = self.collision.frame_rates
        return 0.0 if rates is None else -float(self.impulse @ rates)

    @cached_property
    def antidissipative(self) -> np.ndarray:
        """Contacts that gave energy, ``Lambda_i gamma_bar_i > 0``, bool (h,); both factors must exceed rounding."""
        scale = self.collision.gradient_norms
        smallest = SIGNIFICANT * self.collision.pre_speed
        return (self.impulse * scale > smallest) & (self.mean_contact_velocity > smallest * scale)

    @property
    def has_distant_effect(self) -> bool:
        """Whether any contact is antidissipative: energy reached it from elsewhere."""
        return bool(self.antidissipative.any())

    @cached_property
    def violations(self) -> Violations:
        """The distances of v+ from the three sets whose intersection is S(v-)."""
        c, jump = self.collision, self.whitened_jump
        return measured(c, jump, self.post_contact_velocity, *pushed(c, jump, self.found_impulse), c.pre_speed)

    @cached_property
    def residual(self) -> float:
        """Certificate, relative to the larger of ``|v-|`` and ``|v+|``, from v+, Lambda and the collision alone.

        It is the largest of ``|M (v+ - v-) - J^T Lambda|`` (dual kinetic norm, beyond the rounding of Lambda itself)
        and, for each contact, the negative part of ``Lambda_i sqrt(G_ii)`` and, if the outcome is that of a law, the
        natural map ``min(Lambda_i sqrt(G_ii), (gamma+_i - gamma^h_i) / sqrt(G_ii))`` of its complementarity
        ``0 <= Lambda_i  ⊥  gamma+_i - gamma^h_i >= 0``. Under Poisson's law ``Lambda - (1 + e) Lambda_C`` replaces
        Lambda in the natural map, and the residual of the compression counts, too.
        """
        c = self.collision
        scale = c.gradient_norms
        scaled_impulse = self.impulse * scale
        error = imbalance(c, self.whitened_jump, self.impulse)
        if self.target_contact_velocity is not None:
            slack = self.post_contact_velocity - self.target_contact_velocity
            moving = scale > 0
            if not moving.all():
                largest = np.abs(self.target_contact_velocity).max()
                if (slack[~moving] < -FIXED * largest).any():
                    return np.inf
            free = self.impulse if self.least_impulse is None else self.impulse - self.least_impulse
            natural = np.minimum((free * scale)[moving], slack[moving] / scale[moving])
            error = max(error, float(np.abs(natural).max(initial=0.0)))
        error = max(error, float(-scaled_impulse.min(initial=0.0)))
        error = error / self._speed if self._speed > 0 else error
        return error if self.compression is None else max(error, self.compression.residual)

    @cached_property
    def _speed(self) -> float:
        return larger_speed(self.collision, self.whitened_jump)
