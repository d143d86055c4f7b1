"""The collisions of a step, which become events when they are read."""

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
from impactlaw.solvers.friction.problem import ConeAnswer, ConeProblem
from impactlaw.solvers.friction.solve import BRIEF, STEPS_OF_A_ROUND, THOROUGH, cost, solve_cones
from impactlaw.solvers.problem import Status
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.time_stepping.problem.contact_snapshot import ContactSnapshot, in_order
from impactlaw.stepping.time_stepping.tolerances import DRIVEN, is_met

_ROUNDING = 1e-12  # energy that counts as rounding, relative to the kinetic energy of all bodies
_WORK = 2e3  # work after which no further attempt to find the impulses of a collision by itself begins, see `cost`
_PARTS = 1.0, 0.3, 0.03  # of impulses of the convex relaxation, as starting points where more would take too much work


@dataclass(frozen=True, eq=False)
class CollisionRecord:
    """A collision in a step: copies of everything that its event needs.

    The event describes the collision by itself, at the velocity of the start of the step and without the other forces
    of the step: ``v+ = v- + M_h^-1 J^T Lambda`` reaches the same contact velocities as the step. The other forces
    include equality constraints that collisions may violate, such as servos. They also include constraints that drift
    and would drive the collision, or lock it, if they kept their velocity: in the step these give way, see
    `problem.solution.driving_equalities`.
    """

    seen: ContactSnapshot  # contacts, rows and inertia in the middle of the step
    collides: np.ndarray  # groups that collide, bool (g,)
    impulse: np.ndarray  # impulses of the step, in units of the problem, (n,)
    time: float  # in the middle of the step, s
    qpos: np.ndarray  # configuration in the middle of the step, (nq,)
    velocity: np.ndarray  # v-, (nv,)
    after: np.ndarray  # velocity at the end of the step, (nv,)
    target: np.ndarray  # ``gamma^h`` of groups, (g,)
    sliding: np.ndarray  # target sliding velocities, scaled like restitution, (n,)
    exact: bool  # whether friction is exact Coulomb friction, or else its convex relaxation
    # share of the law's restitution that was kept so that no energy is created, in [0, 1]; the least one if there are
    # several
    share: float
    created: float  # energy that the law would create in the step without scaling, J
    dissipative: bool  # whether restitution is scaled in each island so that it creates no energy there

    @cached_property
    def event(self) -> ImpactEvent:
        """The collision as an event."""
        pushed = self.impulse[self.seen.rows.first] > 0.0
        groups = in_order(self.seen.rows, self.seen.reached(self.collides, pushed))
        contacts = self.seen.contacts(groups)
        impact = self._resolve(groups, contacts.labels)
        projected = self.share < 1.0 or impact.target_contact_velocity is None
        judged = self.share < 1.0 or self.created > 0.0
        return ImpactEvent(self.time, contacts, impact, self.qpos, projected, judged)

    def _resolve(self, groups: np.ndarray, labels: tuple[str, ...]) -> Impact:
        """Return the impact, without restitution if by itself it has no solution with it, or would create energy."""
        solved = True

        def resolve(acts: np.ndarray) -> tuple[Impact, bool | None]:
            nonlocal solved
            collision = self.seen.collision(groups, self.velocity, labels, friction=True, acts=acts)
            impact, solved = self._impact(collision, groups)
            # if the step itself meets the law, constraints are the reason
            return impact, None if solved else self._is_met(collision, groups)

        impact, _ = beside_constraints(self.seen, groups, resolve, gains=self.dissipative)
        if not solved and not self._is_met(impact.collision, groups):
            return impact
        if solved and not (self.dissipative and _creates_energy(impact, self.seen, groups)):
            return impact
        alone, found = self._impact(impact.collision, groups, kept=0.0)
        return alone if found else impact

    def _is_met(self, collision: Collision, groups: np.ndarray) -> bool:
        """Return whether the step has met the law at the contacts that collide."""
        missed = (self.target[groups] - collision.contact_velocity_after(self.after))[self.collides[groups]]
        return is_met(missed.max(initial=0.0), np.abs(collision.pre_contact_velocity).max())

    def _impact(self, collision: Collision, groups: np.ndarray, kept: float = 1.0) -> tuple[Impact, bool]:
        """Return the impact with a part of its targets, and whether it meets them."""
        target = kept * np.where(self.collides, self.target, 0.0)[groups]
        if collision.friction is None:
            problem = jump_problem(collision, Target(target))
            try:
                answer = solve_with_jump(problem, collision.labels, shared=False)
            except (UnsolvableLawError, SolverError):  # the step went to the nearest point
                return Impact.observed(collision, self.after), False
            impact = Impact.solved(collision, problem, answer, target)
            if kept * self.share < 1.0:  # scaled restitution: not the outcome of the law itself
                return replace(impact, target_contact_velocity=None), True
            return impact, True
        tangential = self.seen.tangential(groups)[0]
        targets = target, kept * self.sliding[tangential]
        problem = cone_problem(collision, *targets, exact=self.exact)
        guess = np.append(self.impulse[self.seen.rows.first[groups]], self.impulse[tangential])
        answer = _find_impulses(problem, guess[collision.cone_rows.order])
        solved = answer.status is Status.SOLVED
        if not solved:  # the step went to the nearest point
            with suppress(SolverError):
                return FrictionImpact.observed(collision, self.after), False
        told = targets if solved and kept == 1.0 else None
        more = {"restitution_scale": kept * self.share, "exact": self.exact, "cones": problem}
        return FrictionImpact.of_cones(collision, answer.impulse, answer.jump, told, **more), solved


def events_of(records: tuple[CollisionRecord, ...]) -> tuple[ImpactEvent, ...]:
    """Return collisions as events."""
    return tuple(record.event for record in records)


def _find_impulses(problem: ConeProblem, guess: np.ndarray) -> ConeAnswer:
    """Solve the problem of a collision with friction; a thorough search takes minutes where dozens of bodies jam."""
    start, step = cost(problem.start.size, problem.rows.shape[1])
    most = max(0.0, (_WORK - start) / step)
    rounds = max(1, min(THOROUGH, int(most / STEPS_OF_A_ROUND)))
    answer = solve_cones(problem, guess, rounds=rounds, most=most)
    if answer.status is Status.SOLVED or not problem.exact or rounds > BRIEF:
        return answer
    relaxed = solve_cones(problem.relaxed, rounds=rounds, most=most)
    for part in _PARTS:
        answer = solve_cones(problem, part * relaxed.impulse, rounds=rounds, most=most)
        if answer.status is Status.SOLVED:
            break
    return answer


def beside_constraints(
    seen: ContactSnapshot,
    groups: np.ndarray,
    resolve: Callable[[np.ndarray], tuple[Impact, bool | None]],
    *,
    gains: bool = False,
) -> tuple[Impact, np.ndarray]:
    """Return the impact beside equality constraints, and which of these act in it, bool (g,).

    At first all of them act. In islands in which they drive or lock the collision, only constraints act whose velocity
    the step keeps; if these drive or lock it, too, no constraint of the island acts.

    Args:
        seen: contacts and constraints of the collision.
        groups: the contacts, int (h,).
        resolve: returns the impact beside the constraints that act, bool (g,), and whether they lock the collision;
            None to judge each island by the work of its constraints.
        gains: whether constraints beside which the contacts themselves create energy count as driving them, too.
    """
    rows, acts = seen.rows, seen.kept
    impact, locked = resolve(acts)
    if impact.collision.bilateral_jacobian is None:
        return impact, acts
    held, (label, island) = rows.compliance[rows.first] < rows.amounts[1], seen.islands()
    for may in (held, np.zeros_like(held)):
        driven = _driven_islands(impact, label, groups, island, gains=gains)
        if locked is not None:
            driven[:-1] = locked
        if not driven.any():
            break
        acts = acts & (may | ~driven[label])
        impact, locked = resolve(acts)
    return impact, acts


def _creates_energy(impact: Impact, seen: ContactSnapshot, groups: np.ndarray) -> bool:
    """Return whether contacts create more than the part `DRIVEN` of energy in an island, see `_driven_islands`."""
    label, island = seen.islands()
    return bool(_driven_islands(impact, label, groups, island, gains=True).any())


def _driven_islands(
    impact: Impact, label: np.ndarray, groups: np.ndarray, island: np.ndarray, *, gains: bool
) -> np.ndarray:
    """Return in which islands equality constraints drive a collision by their drift, bool (islands + 1,), False last.

    There the constraints alone, and also constraints and contacts together, add more than a part `DRIVEN` of the energy
    with which the fastest contact collides, in the motion that the constraints allow.

    Args:
        impact: the impact beside the constraints.
        label: island of each group, -1 if it cannot move, (g,).
        groups: the contacts, int (h,).
        island: island of each degree of freedom, -1 if it is in none, (nv,).
        gains: whether islands count, too, in which contacts alone add that much.
    """
    c, many, label = impact.collision, label.max(initial=-1) + 1, label[groups]
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
    if gains:
        driven |= total - work > DRIVEN * energy
    return np.append(driven[1:], False)
