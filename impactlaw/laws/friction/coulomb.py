"""Coulomb friction beside any law with a target."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from impactlaw.errors import RestitutionError, SolverError, UnknownNameError
from impactlaw.laws.base import Law, Target, aim, coefficient
from impactlaw.laws.friction.groups import apart, groups_of, joined, ties_of, work_of_each
from impactlaw.laws.friction.poisson_phases import resolve_phases
from impactlaw.laws.poisson import Poisson
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact, cone_problem
from impactlaw.mechanics.impact import Impact
from impactlaw.solvers.friction.problem import ConeAnswer, ConeProblem
from impactlaw.solvers.friction.solve import BRIEF, THOROUGH, Effort, shared, solve_within
from impactlaw.solvers.problem import Status

_CREATED = 1e-12
"""Energy, relative to the one before, up to which its creation is rounding."""
_SEARCHES = 60
_FOUND = 1e-10  # width of the bracket of s that is narrow enough
_SOLVABLE = 0.03  # the same where beyond the bracket no impact was found
_CLOSE = 1e-11  # energy lost, relative to the one before, that is as good as none


@dataclass(frozen=True)
class Coulomb(Law):
    """The normal law of ``law``, and Coulomb friction with restitution along the tangents.

    With ``u_n = gamma+ - gamma^h`` and ``u_t = gamma_t+ + e_t gamma_t-`` each contact has
    ``0 <= Lambda_n  ⊥  u_n >= 0``, ``sum (Lambda_t / mu)^2 <= Lambda_n^2``, and friction opposes ``u_t`` with all it
    can: exact Coulomb friction, ``K ∋ Lambda  ⊥  u + |mu u_t| e_n ∈ K`` (G. de Saxcé and Z.-Q. Feng, Math. Comput.
    Model. 28, 1998). The relaxation ``K ∋ Lambda  ⊥  u ∈ K`` (M. Anitescu, Math. Program. 105, 2006) is convex; in it a
    contact that slides also separates.

    Restitution and friction together can create energy (T. R. Kane, *A dynamics puzzle*, 1984). If they do, all
    restitution is scaled: the positive part of ``gamma^h`` and ``e_t`` are multiplied by the largest s in [0, 1], found
    by a bracketed search, with which no energy is created, ``Lambda^T gamma_bar + Lambda_t^T gamma_bar_t <= 0``, with
    surfaces whose velocity jumps at w+ from the start. s = 0 never creates any; so the law is dissipative.
    Contacts that do not influence each other, neither through bodies nor through a matrix of the law, are judged and
    scaled by themselves, group by group. `FrictionImpact.restitution_scale` is the least s used; it is below 1 also
    where no impulse in the friction cones reaches the law's full restitution.

    Without rows of friction the outcome is that of ``law``. A contact that no normal impulse moves, as it meets the
    axis of a hinge, has no friction: any normal impulse would do, and any friction with it. Large coefficients of
    friction may leave several solutions; the same collision always gets the same one.

    Around `Poisson` it is compression and expansion, each with friction (`poisson_phases`). There s scales
    the coefficients of restitution, and e_t must be 0.

    Attributes:
        law: what decides ``gamma^h``, or Poisson's law; another one with a rule of its own for impulses is refused.
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

    @property
    def contact_labels(self) -> frozenset[str]:
        """Labels that the inner law is keyed with."""
        return self.law.contact_labels

    def seeded(self, seed: int) -> Coulomb:
        """Return the law with this seed in the inner law, if that draws its outcomes and has none."""
        inner = self.law.seeded(seed)
        return self if inner is self.law else replace(self, law=inner)

    def target(self, collision: Collision) -> Target:
        """Return ``gamma^h`` of the inner law."""
        return aim(self.law, collision)

    def resolve(self, collision: Collision, *, solver: str = "auto", effort: Effort | None = None) -> Impact:
        """Return the impact: a `FrictionImpact` where the collision has friction.

        Args:
            collision: what collides.
            solver: of collisions without friction, see `Law.resolve`.
            effort: limits the work, as in the steps of a simulation; without it no effort is spared.

        Raises:
            RestitutionError: the law's coefficients do not fit the number of contacts.
            UnknownNameError: no such solver, where there is no friction.
            UnsolvableLawError: surfaces move against each other so that no velocity is left.
            SolverError: no answer passed its certificate.
        """
        collision = collision.without_idle_friction
        if collision.friction is None or not len(collision.friction):
            return self.law.resolve(collision, solver=solver)
        if isinstance(self.law, Poisson):
            return resolve_phases(self.law, collision, exact=self.cone == "exact", effort=effort)
        wanted = np.asarray(self.target(collision).contact_velocity, dtype=float)
        parts: list[tuple[np.ndarray, FrictionImpact]] = []
        for contacts, part in apart(collision, self.law):
            if effort is not None:
                effort.begin_part()
            parts.append((contacts, _resolved(_Attempt(self, part, wanted[contacts], effort, collision), solver)))
        if not parts:
            return _resolved(_Attempt(self, collision, wanted, effort, collision), solver)
        exact = self.cone == "exact"
        return joined(collision, parts, exact=exact, problem=cone_problem(collision, exact=exact))


class _Attempt:
    """The law with its restitution scaled."""

    def __init__(
        self, law: Coulomb, collision: Collision, wanted: np.ndarray, effort: Effort | None, all_of_it: Collision
    ):
        self.law, self.collision, self.wanted, self.effort = law, collision, wanted, effort
        self.all_of_it, self.shares = all_of_it, False
        self.problem: ConeProblem | None = None
        self.sliding = -law.tangential_restitution * collision.pre_sliding_velocity

    def part(self, contacts: np.ndarray) -> _Attempt:
        """Return the law for some contacts alone, ascending, with the targets that they have among all."""
        part = _Attempt(self.law, self.collision.part(contacts), self.wanted[contacts], self.effort, self.all_of_it)
        part.shares = self.problem is not None and self.problem.is_redundant
        return part

    @property
    def scales(self) -> bool:
        """Whether there is any restitution; without it the problem is the same for all s."""
        return bool(np.count_nonzero(self.wanted > 0.0) or np.count_nonzero(self.sliding))

    def __call__(self, s: float, guess: np.ndarray | None, rounds: int) -> tuple[FrictionImpact | None, ConeAnswer]:
        """Return the impact with restitution scaled by s, None if none is certified, and the solver's answer."""
        targets = np.where(self.wanted > 0, s * self.wanted, self.wanted), s * self.sliding
        exact = self.law.cone == "exact"
        problem = self.problem = cone_problem(self.collision, *targets, exact=exact, known=self.problem)
        answer = solve_within(problem, guess, rounds, self.effort)
        if answer.status is not Status.SOLVED:
            return None, answer
        if problem.is_redundant or self.shares:
            answer = shared(problem, answer)
        impulse, jump = answer.impulse, answer.jump
        return FrictionImpact.of_cones(
            self.collision, impulse, jump, targets, scale=s, exact=exact, problem=problem
        ), answer

    def created(self, impact: FrictionImpact, answer: ConeAnswer, work: float) -> float:
        """Work of impulses of contact, J, relative to the kinetic energy, less what may be rounding."""
        speed = max(self.collision.pre_speed, impact.intensity)
        if speed == 0.0:
            return 0.0
        return 2.0 * work / speed**2 - _CREATED - 4.0 * answer.residual / speed


def _resolved(attempt: _Attempt, solver: str) -> FrictionImpact:
    """Return the impact: with all restitution, or what is left of it where that creates energy or has no solution."""
    impact, answer = attempt(1.0, None, THOROUGH)
    if not attempt.scales:
        return _largest(attempt, np.inf, (impact, answer), solver) if impact is None else impact
    if impact is not None and attempt.created(impact, answer, np.maximum(work_of_each(impact), 0.0).sum()) <= 0.0:
        return impact
    assert attempt.problem is not None
    groups = groups_of(attempt.problem, ties_of(attempt.law.law, attempt.collision))
    if len(groups) > 1:
        return _by_group(attempt, groups, (impact, answer), solver)
    created = np.inf if impact is None else attempt.created(impact, answer, impact.work_after_jump)
    return impact if impact is not None and created <= 0.0 else _largest(attempt, created, (impact, answer), solver)


def _by_group(
    attempt: _Attempt, groups: list[np.ndarray], whole: tuple[FrictionImpact | None, ConeAnswer], solver: str
) -> FrictionImpact:
    """Return the impact with restitution scaled in those groups of contacts alone that create energy.

    Args:
        attempt: the law.
        groups: contacts that influence each other.
        whole: what was found with s = 1.
        solver: of the problem without friction.
    """
    impact, answer = whole
    work = np.zeros(len(attempt.wanted)) if impact is None else work_of_each(impact)
    parts: list[tuple[np.ndarray, FrictionImpact]] = []
    for contacts in groups:
        created = np.inf if impact is None else attempt.created(impact, answer, work[contacts].sum())
        if impact is not None and created <= 0.0:
            parts.append((contacts, impact))
            continue
        if attempt.effort is not None:
            attempt.effort.begin_part()
        part, own, found = attempt.part(contacts), impact, answer
        if own is None:
            own, found = part(1.0, None, THOROUGH)
            created = np.inf if own is None else part.created(own, found, own.work_after_jump)
        if own is None or (created > 0.0 and part.scales):
            own = _largest(part, created, (own, found), solver)
        parts.append((contacts, own))
    if all(part is impact for _, part in parts) and impact is not None:
        return impact
    return joined(attempt.collision, parts, exact=attempt.law.cone == "exact", problem=attempt.problem)


def _largest(
    attempt: _Attempt, created: float, whole: tuple[FrictionImpact | None, ConeAnswer], solver: str
) -> FrictionImpact:
    """Return the impact of the largest s that creates no energy, by Illinois' false position or bisection.

    Args:
        attempt: the law.
        created: energy created with s = 1, infinite if there is no impact.
        whole: what was found with s = 1.
        solver: of the problem without friction.
    """
    best, answer = attempt(0.0, None, THOROUGH) if attempt.scales else whole
    if best is None:
        attempt.law.law.resolve(attempt.all_of_it, solver=solver)  # refuses what no velocity can do
        raise SolverError(
            f"no impulses in the friction cones of contacts {', '.join(attempt.collision.labels)} were found: residual "
            f"{answer.residual:.1e} sqrt(J) after {answer.iterations} steps"
        )
    if not np.isfinite(created) and attempt.effort is not None and attempt.effort.hasty:
        return best
    low, high, above, side = 0.0, 1.0, created, 0
    kept = attempt.created(best, answer, best.work_after_jump)
    for k in range(_SEARCHES):
        if high - low <= (_FOUND if np.isfinite(above) else _SOLVABLE):
            break
        share = kept / (kept - above) if k % 3 != 2 and np.isfinite(above) and kept < above else 0.5
        s = low + min(max(share, 0.01), 0.99) * (high - low)
        impact, following = attempt(s, answer.impulse, BRIEF)
        created = np.inf if impact is None else attempt.created(impact, following, impact.work_after_jump)
        if impact is None or created > 0.0:
            high, above, kept, side = s, created, kept * (0.5 if side > 0 else 1.0), 1
            continue
        low, kept, above, side = s, created, above * (0.5 if side < 0 else 1.0), -1
        best, answer = impact, following
        if created > -_CLOSE:
            break
    return best
