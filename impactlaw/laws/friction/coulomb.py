"""Coulomb friction added to any law with a target."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import compress
from typing import Literal

import numpy as np

from impactlaw.errors import RestitutionError, SolverError, UnknownNameError
from impactlaw.laws.base import Law, Target, aim, checked, coefficient
from impactlaw.laws.friction.poisson_phases import TwoPhases
from impactlaw.laws.friction.scaled import Attempt, Outcome, resolve_scaled
from impactlaw.laws.poisson import Poisson
from impactlaw.laws.tolerances import LOST
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact, cone_problem
from impactlaw.mechanics.impact import Impact
from impactlaw.solvers import check_solver
from impactlaw.solvers.friction.problem import ConeAnswer
from impactlaw.solvers.friction.solve import Effort, shared


@dataclass(frozen=True)
class Coulomb(Law):
    """A law for the normal directions, with Coulomb friction and tangential restitution.

    With ``u_n = gamma+ - gamma^h`` and ``u_t = gamma_t+ + e_t gamma_t-`` each contact satisfies
    ``0 <= Lambda_n  ⊥  u_n >= 0`` and ``sum (Lambda_t / mu)^2 <= Lambda_n^2``, and friction dissipates as much as it
    can against ``u_t``. With ``Lambda_t / mu`` and ``mu u_t`` as tangential parts, and ``K = {x : |x_t| <= x_n}``, this
    exact Coulomb friction is ``K ∋ Lambda  ⊥  u + |u_t| e_n ∈ K`` (G. de Saxcé and Z.-Q. Feng, Math. Comput. Model. 28,
    1998). The relaxation ``K ∋ Lambda  ⊥  u ∈ K`` (M. Anitescu, Math. Program. 105, 2006) is convex; in it a contact
    that slides also separates.

    Restitution and friction together can create energy (T. R. Kane, *A dynamics puzzle*, 1984). If they do, all
    restitution is scaled: the positive part of ``gamma^h`` and ``e_t`` are multiplied by the largest s in [0, 1] that
    creates no energy, found by a bracketed search. The criterion is
    ``Lambda^T gamma_bar + Lambda_t^T gamma_bar_t <= 0``, in which surfaces whose velocity jumps have w+ from the start.
    s = 0 never creates energy, so the law is dissipative. Groups of contacts that do not influence each other, neither
    through bodies nor through a matrix of the law, are checked and scaled separately.
    `FrictionImpact.restitution_scale` is the least s used; it is below 1 also where no impulse in the friction cones
    reaches the law's full restitution.

    Without rows of friction the outcome is that of ``law``. A contact that no normal impulse can move, such as one
    whose normal meets the axis of a hinge, gets no friction: its normal impulse would be arbitrary, and its friction
    with it. Large coefficients of friction may leave several solutions; the same collision always gets the same one.

    With `Poisson` as the inner law, compression and expansion each have friction (`poisson_phases`). s then scales the
    coefficients of restitution, and e_t must be 0.

    Attributes:
        law: the law that gives ``gamma^h``, or Poisson's law; other laws with their own rule for impulses are refused.
        tangential_restitution: e_t in [0, 1].
        cone: "exact" or "convex".

    Raises:
        RestitutionError: e_t is not in [0, 1], or not 0 with Poisson's law, or the law has no target.
        UnknownNameError: cone is neither "exact" nor "convex".
    """

    law: Law
    tangential_restitution: float = field(default=0.0, kw_only=True)
    cone: Literal["exact", "convex"] = field(default="exact", kw_only=True)
    has_friction = True

    def __post_init__(self):
        if not isinstance(self.law, Law):
            raise RestitutionError(f"Coulomb extends a law, such as Coulomb(Moreau(0.5)), got {self.law!r}")
        if not self.law.has_target and type(self.law).resolve is not Poisson.resolve:
            raise RestitutionError(
                f"Coulomb needs a law that aims at contact velocities; {type(self.law).__name__} has a rule of its own "
                "for impulses. Extend Moreau, Newton, Poisson, Fremond, LinearMap or Compliant"
            )
        e = coefficient(self.tangential_restitution, "tangential restitution")
        if e and isinstance(self.law, Poisson):
            raise RestitutionError(
                "Coulomb(Poisson(...)) has no tangential restitution: friction of its expansion is Coulomb's; leave "
                f"tangential_restitution={e:g} out"
            )
        object.__setattr__(self, "tangential_restitution", e)
        if self.cone not in ("exact", "convex"):
            raise UnknownNameError("cone", self.cone, ["exact", "convex"])

    @property
    def normal_law(self) -> Law:
        """The inner law."""
        return self.law

    def seeded(self, seed: int) -> Coulomb:
        """Return the law with this seed set in the inner law, if that draws its outcomes and has no seed."""
        inner = self.law.seeded(seed)
        return self if inner is self.law else replace(self, law=inner)

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h`` of the inner law."""
        return aim(self.law, collision)

    def resolve(self, collision: Collision, *, solver: str = "auto", effort: Effort | None = None) -> Impact:
        """Return the impact, see `Law.resolve`; it is a `FrictionImpact` if the collision has friction.

        ``solver`` is used for collisions without friction. ``effort`` limits the work, as the steps of a simulation
        do; without it the work is not limited.

        Raises:
            UnknownNameError: there is no such solver.
            UnsolvableLawError: surfaces move against each other so that no velocity is possible.
            SolverError: no answer passed its certificate, or coefficients of friction, of some 1e7 or more, are so
                large that gap velocities are lost in their rounding.
        """
        check_solver(solver)
        collision = checked(collision).without_idle_friction
        if collision.friction is None or not len(collision.friction):
            return self.law.resolve(collision, solver=solver)
        limits = {"exact": self.cone == "exact", "effort": effort, "solver": solver, "whole": collision}
        if isinstance(self.law, Poisson):
            collision = collision.after_surface_jump
            attempt = TwoPhases(self.law, collision, self.law.coefficients(collision), **limits)
        else:
            wanted = self.target(collision).contact_velocity
            attempt = _Aimed(self.law, collision, wanted, e=self.tangential_restitution, **limits)
        return _checked(resolve_scaled(attempt))


def _checked(impact: FrictionImpact) -> FrictionImpact:
    """Return the impact; refuse it if gap velocities are lost in the rounding of large coefficients of friction."""
    c, target = impact.collision, impact.target_contact_velocity
    slack = impact.post_contact_velocity if target is None else impact.post_contact_velocity - target
    lost = slack < -LOST * max(c.pre_speed, impact.intensity) * c.gradient_norms
    if np.count_nonzero(lost):
        named = ", ".join(compress(c.labels, lost))
        raise SolverError(f"coefficients of friction of contacts {named} are too large to be resolved; 100 will do")
    return impact


@dataclass(eq=False)
class _Aimed(Attempt):
    """An attempt to reach the contact velocities `wanted` by a law, and ``-e gamma_t-`` along the tangents."""

    e: float = field(kw_only=True)  # tangential restitution
    # whether contacts share impulses even if these are unique: so do parts of redundant contacts
    shares: bool = field(default=False, kw_only=True)

    def part(self, contacts: np.ndarray, collision: Collision | None = None) -> Attempt:
        """Return the attempt for some contacts alone, indices ascending, with their targets in the whole collision."""
        return replace(super().part(contacts, collision), shares=self.problem is not None and self.problem.is_redundant)

    def scales(self, contacts: np.ndarray | slice = slice(None)) -> bool:
        """Whether some contacts have any restitution; without it the outcome is the same for all s."""
        return self.e > 0.0 or super().scales(contacts)

    def outcome(self, s: float, near: ConeAnswer | None = None) -> Outcome:
        """Return the outcome with positive targets multiplied by s."""
        c = self.collision
        targets = np.where(self.wanted > 0, s * self.wanted, self.wanted), -s * self.e * c.pre_sliding_velocity
        problem = self.problem = cone_problem(c, *targets, exact=self.exact, known=self.problem)
        answer = self.solved(problem, near)
        if problem.is_redundant or self.shares:
            answer = shared(problem, answer)
        kept = {"restitution_scale": s, "exact": self.exact, "cones": problem}
        return Outcome(FrictionImpact.of_cones(c, answer.impulse, answer.jump, targets, **kept), answer)
