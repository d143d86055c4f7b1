"""Restitution with friction, scaled down where it would create energy, in each group of contacts separately."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from impactlaw.errors import SolverError
from impactlaw.laws.base import Law
from impactlaw.laws.friction.groups import apart, groups_of, joined, ties_of
from impactlaw.laws.friction.share import AIM, CREATED, FOUND, SEARCHES, SOLVABLE, next_share
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact, cone_problem
from impactlaw.solvers.friction.problem import ConeAnswer, ConeProblem
from impactlaw.solvers.friction.solve import BRIEF, THOROUGH, Effort, solve_within
from impactlaw.solvers.problem import Status


class Outcome(NamedTuple):
    """An impact, and the answer of the cone problem that it was made from."""

    impact: FrictionImpact
    answer: ConeAnswer


@dataclass(eq=False)
class Attempt(ABC):
    """A law with friction applied to a collision, with its restitution scaled by a number s in [0, 1]."""

    law: Law  # the law along the normals
    collision: Collision  # the contacts, with rows of friction
    # a measure of the restitution of each contact, shape (h,), as subclasses define it; positive where the contact has
    # restitution
    wanted: np.ndarray
    exact: bool = field(kw_only=True)  # whether friction is exact Coulomb friction, or else its convex relaxation
    effort: Effort | None = field(kw_only=True)  # limits the work; None is no limit
    solver: str = field(kw_only=True)  # name of the solver for the collision without friction
    whole: Collision = field(kw_only=True)  # the collision of which these contacts are a part
    # a cone problem of these contacts, if one has been made
    problem: ConeProblem | None = field(default=None, init=False)

    @abstractmethod
    def outcome(self, s: float, near: ConeAnswer | None = None) -> Outcome:
        """Return the outcome with restitution scaled by s; ``near``, the answer for another s, is the initial guess.

        Raises:
            SolverError: no answer passed its certificate.
        """

    def scales(self, contacts: np.ndarray | slice = slice(None)) -> bool:
        """Whether some contacts have any restitution; without it the outcome is the same for all s."""
        return bool(np.count_nonzero(self.wanted[contacts] > 0.0))

    def part(self, contacts: np.ndarray, collision: Collision | None = None) -> Attempt:
        """Return the attempt for some contacts alone, indices ascending, with their restitution in the collision."""
        if self.effort is not None:
            self.effort.begin_part()
        collision = self.collision.part(contacts) if collision is None else collision
        return replace(self, collision=collision, wanted=self.wanted[contacts])

    def solved(self, problem: ConeProblem, near: ConeAnswer | None = None) -> ConeAnswer:
        """Return the certified answer of a cone problem; raise `SolverError` if none was found."""
        guess, rounds = (None, THOROUGH) if near is None else (near.impulse, BRIEF)
        answer = solve_within(problem, guess, rounds, self.effort)
        if answer.status is not Status.SOLVED:
            raise SolverError(
                f"no impulses in the friction cones of contacts {', '.join(self.collision.labels)} were found: "
                f"residual {answer.residual:.1e} sqrt(J) after {answer.iterations} steps"
            )
        return answer

    def tried(self, s: float, near: ConeAnswer | None = None) -> Outcome | None:
        """Return `outcome`, or None if no answer passed its certificate."""
        try:
            return self.outcome(s, near)
        except SolverError:
            return None

    def refusing(self, s: float) -> Outcome:
        """Return `outcome`; if it fails, resolve without friction, which raises if no velocity satisfies the law."""
        try:
            return self.outcome(s)
        except SolverError:
            self.law.resolve(self.whole, solver=self.solver)
            raise

    def created(self, outcome: Outcome | None, work: float) -> float:
        """Return the work of contact impulses, J, relative to the kinetic energy, less an allowance for rounding.

        Without an outcome it is infinite.
        """
        if outcome is None:
            return np.inf
        speed = max(self.collision.pre_speed, outcome.impact.intensity)
        return 2.0 * work / speed**2 - CREATED - 4.0 * outcome.answer.residual / speed if speed > 0.0 else 0.0


def resolve_scaled(attempt: Attempt) -> FrictionImpact:
    """Return the impact of all contacts; parts that share no degrees of freedom are resolved separately."""
    parts = [
        (contacts, _resolved(attempt.part(contacts, alone)))
        for contacts, alone in apart(attempt.collision, attempt.law)
    ]
    return joined(attempt.collision, parts) if parts else _resolved(attempt)


def _resolved(attempt: Attempt, *, one_group: bool = False) -> FrictionImpact:
    """Return the impact, with restitution scaled only in the groups of contacts that create energy."""
    if not attempt.scales():
        return attempt.refusing(1.0).impact
    c, whole = attempt.collision, attempt.tried(1.0)
    work = np.zeros(len(c.labels)) if whole is None else whole.impact.work_of_each
    if whole is not None and attempt.created(whole, np.maximum(work, 0.0).sum()) <= 0.0:
        return whole.impact
    groups = [np.arange(len(work))]
    if not one_group:
        groups = groups_of(cone_problem(c, exact=attempt.exact, known=attempt.problem), ties_of(attempt.law, c))
    parts: list[tuple[np.ndarray, FrictionImpact]] = []
    for contacts in groups:
        created = attempt.created(whole, work[contacts].sum())
        if whole is not None and (created <= 0.0 or not attempt.scales(contacts)):
            parts.append((contacts, whole.impact))
        elif len(groups) == 1:
            return _largest(attempt, created)
        else:
            part = attempt.part(contacts)
            own = _resolved(part, one_group=True) if whole is None else _largest(part, created)
            parts.append((contacts, own))
    if whole is not None and all(impact is whole.impact for _, impact in parts):
        return whole.impact
    return joined(c, parts)


def _largest(attempt: Attempt, created: float) -> FrictionImpact:
    """Return the impact of the largest s that creates no energy, found by parabolas or bisection.

    ``created`` is the energy created by s = 1, see `Attempt.created`.
    """
    best = attempt.refusing(0.0)
    if not np.isfinite(created) and attempt.effort is not None and attempt.effort.hasty:
        return best.impact
    low, high, third, stalled = 0.0, 1.0, np.nan, False
    below, above, beyond = attempt.created(best, best.impact.work_after_jump) + AIM, created + AIM, np.nan
    for _ in range(SEARCHES):
        if high - low <= (FOUND if np.isfinite(above) else SOLVABLE):
            break
        s = next_share(low, high, third, below, above, beyond, stalled)
        found = attempt.tried(s, best.answer)
        missed = attempt.created(found, 0.0 if found is None else found.impact.work_after_jump) + AIM
        stalled = abs(missed) > 0.5 * min(abs(below), above)
        if found is None or missed > AIM:
            third, high, beyond, above = high, s, above, missed
            continue
        third, low, beyond, below, best = low, s, below, missed, found
        if missed > -AIM:
            break
    return best.impact
