"""The collisions of compiled steps: sums at once, events when they are read."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import SolverError, UnfinishedStepError, UnsolvableLawError
from impactlaw.laws import Coulomb, Law, Target
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact, cone_gradients, cone_problem
from impactlaw.mechanics.impact import Impact
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.solvers.friction.problem import ENOUGH, ConeAnswer, ConeProblem
from impactlaw.solvers.friction.solve import BRIEF, THOROUGH, shared, solve_cones
from impactlaw.solvers.problem import Status
from impactlaw.stepping.collisions import Closed, Collider, as_closed
from impactlaw.stepping.impact_event import ImpactEvent, ImpactSums, changed_model
from impactlaw.stepping.integration import restore_state
from impactlaw.stepping.soft.compiled.collide import SUMS
from impactlaw.stepping.soft.scheme import SoftStepping
from impactlaw.stepping.soft.tolerances import WORK
from impactlaw.stepping.work import Work

_AGAIN = 1e-4  # largest deviation of the intensity of repeated collisions, relative to the intensity
_STILL = 1e-7  # velocity after a collision, relative to its speed, up to which a contact sticks, or touches
_KEPT = 1e-7  # largest change of the velocity of a constraint that is kept, relative to the largest of its terms
_SAME = 1e-9  # largest difference between two outcomes of a law that are the same, relative to the largest velocity


@dataclass(frozen=True, eq=False)
class _Known(Law):
    """A law with known outcomes: impulses are looked for near those that lead to them, not anew.

    A search could take seconds where many bodies collide, and where friction is indeterminate it could find another
    solution.
    """

    law: Law
    outcomes: deque[np.ndarray]  # see `world.Law.outcomes`

    def target(self, collision: Collision) -> Target:
        """Return the target of the law."""
        return self.law.target(collision)

    def resolve(self, collision: Collision, *, solver: str = "auto") -> Impact:
        """Return the impact with the next known outcome."""
        if self.outcomes and not _keeps_constraints(collision, self.outcomes[0][:-2]):
            self.outcomes.clear()  # all these are known when the collisions begin anew
        if not self.outcomes:
            return self._by_law(collision, solver)
        *velocity, kept, _ = self.outcomes.popleft()
        velocity = np.array(velocity)
        c = collision.without_idle_friction
        if isinstance(self.law, Coulomb) and self.law.law.has_target and c.friction is not None and len(c.friction):
            known = self.law, c, velocity, float(kept)
            near = _with_friction(*known)
            if near is not None and near.residual <= _SAME:
                return near
            return self._again(collision, velocity) or near or _fitted(*known)
        return _with_velocity(self._by_law(collision, solver), velocity)

    def _again(self, collision: Collision, velocity: np.ndarray) -> Impact | None:
        """Return the impact by the law, which may scale contacts differently; None if that is not found again."""
        try:
            impact = self._by_law(collision, "auto")
        except (SolverError, UnsolvableLawError, UnfinishedStepError):
            return None
        return replace(impact, post_velocity=velocity) if _is_same(impact.post_velocity, velocity) else None

    def _by_law(self, collision: Collision, solver: str) -> Impact:
        """Return the impact of the law itself, within the work that a step in Python may take."""
        work = Work(len(collision.pre_velocity), WORK, rounds=THOROUGH, once=True)
        return self.law.resolve(collision, solver=solver, **({"effort": work} if isinstance(self.law, Coulomb) else {}))


def _keeps_constraints(collision: Collision, velocity: np.ndarray) -> bool:
    """Return whether constraints keep their velocity; if not, this outcome is one after some of them gave way."""
    if collision.bilateral_jacobian is None:
        return True
    rows = collision.bilateral_jacobian
    largest = np.abs(rows) @ np.maximum(np.abs(collision.pre_velocity), np.abs(velocity))
    return bool(np.all(np.abs(rows @ (velocity - collision.pre_velocity)) <= _KEPT * largest))


def _is_same(velocity: np.ndarray, known: np.ndarray) -> bool:
    return bool(np.abs(velocity - known).max() <= _SAME * np.abs(known).max())


def _with_velocity(impact: Impact, velocity: np.ndarray) -> Impact:
    """Return the impact with a known velocity; if that is another solution, with the impulses nearest to it."""
    if _is_same(impact.post_velocity, velocity):
        return replace(impact, post_velocity=velocity)
    with suppress(SolverError):
        observed = Impact.observed(impact.collision, velocity)
        return replace(observed, target_contact_velocity=impact.target_contact_velocity)
    return impact


def _with_friction(law: Coulomb, collision: Collision, velocity: np.ndarray, kept: float) -> FrictionImpact | None:
    """Return the impact with a known velocity in which all contacts keep the same share of their restitution.

    None if contacts may keep different shares. If no impulses near `_nearest` meet the law, the impact has these, and
    its `residual` says how far they miss it.
    """
    wanted, exact = law.target(collision).contact_velocity, law.cone == "exact"
    along = -kept * law.tangential_restitution * collision.pre_sliding_velocity
    targets = np.where(wanted > 0.0, kept * wanted, wanted), along
    problem, jump = cone_problem(collision, *targets, exact=exact), _jump(collision, velocity)
    x = problem.scaled(impulse := _nearest(problem, jump))
    if (residual := problem.residual(x, problem.velocity(x))) > ENOUGH * problem.scale:
        if kept < 1.0:
            return None
        found = solve_cones(problem, impulse, rounds=0, most=0.0)
        if found.status is Status.SOLVED and _is_same(found.jump, jump):
            impulse, residual = found.impulse, found.residual
    if problem.is_redundant:
        least = shared(problem, ConeAnswer(impulse, jump, residual, Status.SOLVED, 0))
        impulse = least.impulse if _is_same(least.jump, jump) else impulse  # of least norm may be another solution
    known: dict[str, Any] = {"restitution_scale": kept, "exact": exact, "cones": problem}
    return replace(FrictionImpact.of_cones(collision, impulse, jump, targets, **known), post_velocity=velocity)


def _fitted(law: Coulomb, collision: Collision, velocity: np.ndarray, kept: float) -> FrictionImpact:
    """Return the impact with a known velocity and the impulses nearest to its jump, without a target."""
    exact, jump, rows = law.cone == "exact", _jump(collision, velocity), cone_gradients(collision)
    problem = cone_problem(collision, exact=exact)
    found = solve_cones(problem.starting(-(rows @ jump), 0.0).relaxed, rounds=BRIEF)
    known: dict[str, Any] = {"restitution_scale": kept, "exact": exact, "cones": problem}
    return replace(FrictionImpact.of_cones(collision, found.impulse, jump, **known), post_velocity=velocity)


def _jump(collision: Collision, velocity: np.ndarray) -> np.ndarray:
    """Return the jump to a velocity, whitened, (nv,)."""
    return collision.metric.whiten(velocity - collision.pre_velocity)


def _nearest(problem: ConeProblem, jump: np.ndarray) -> np.ndarray:
    """Return impulses nearest to a jump of the whitened velocity, (n,), of those that the velocity after it allows.

    A contact that separates has none, one that slides has its friction against the motion, one that sticks any in its
    cone. Which do what is known with the jump, so that this is a convex problem.
    """
    (h, m), rows = problem.shape, problem.rows.reshape(*problem.shape, -1)
    u = problem.start + rows @ jump
    speed = np.sqrt(np.vecdot(u[:, 1:], u[:, 1:]))
    touches = u[:, 0] <= _STILL * problem.scale + (0.0 if problem.exact else speed)  # the relaxation lifts what slides
    slides = speed > _STILL * problem.scale
    against = np.where(slides[:, None], -u / np.where(slides, speed, 1.0)[:, None], 0.0)
    against[:, 0] = 1.0
    rays = np.einsum("ij,ijk->ik", against, rows)
    sizes = np.where(slides, 1, m)[touches]
    parts = [rays[i : i + 1] if slides[i] else rows[i] for i in np.flatnonzero(touches)]
    x = np.zeros((h, m))
    if parts:
        gradients = np.vstack(parts)
        found = solve_cones(ConeProblem(gradients, -(gradients @ jump), sizes, exact=False), rounds=BRIEF).impulse
        first = np.cumsum(sizes) - sizes
        for i, start in zip(np.flatnonzero(touches), first, strict=True):
            x[i] = found[start] * against[i] if slides[i] else found[start : start + m]
    return problem.unscaled(x)


@as_closed.register
def _(law: _Known) -> Law:
    return _Known(as_closed(law.law), law.outcomes)


@dataclass(frozen=True)
class _KnownCollider(Collider):
    """A collider whose outcomes are known, and judged: those that are fitted to them here are less accurate."""

    outcomes: deque[np.ndarray]  # those of its laws
    begun: list[tuple[np.ndarray, tuple[np.ndarray, ...]]]  # velocity and outcomes when collisions last began

    def collide(self, metric: KineticMetric, closed: Closed, velocity: np.ndarray, **more: Any) -> np.ndarray:
        """Do what `Collider.collide` does; if constraints have given way, with the same outcomes again."""
        if self.begun and np.array_equal(self.begun[0][0], velocity):
            self.outcomes.clear()
            self.outcomes.extend(self.begun[0][1])
        self.begun[:] = [(velocity.copy(), tuple(self.outcomes))] if closed.bilateral is not None else []
        return super().collide(metric, closed, velocity, **more)

    def _as_closed(self, law: Law, collision: Collision, limited: dict[str, Work]) -> Impact | None:
        """Return None if compiled code has found that contacts which open slowly must not take part."""
        if not self.outcomes:
            return super()._as_closed(law, collision, limited)
        return as_closed(law).resolve(collision, solver=self.solver) if self.outcomes[0][-1] else None


def sums_in(found: Iterable[float]) -> ImpactSums:
    """Return the sums that compiled steps have computed."""
    count, energy, intensity, distant, scaled, _, _, work = found
    return ImpactSums(int(count), energy, work, intensity, int(distant), int(scaled))


class StepRepeater:
    """Repeats steps of a scheme, under the law that it has when this is made.

    Args:
        scheme: the scheme in Python.
        compile: makes the compiled stepping of a scheme, which computes the outcomes of collisions.
    """

    def __init__(self, scheme: SoftStepping, compile: Callable[..., Any]):
        self._scheme, self._collider, self._compile = scheme, scheme.collisions.collider, compile

    @cached_property
    def _again(self) -> tuple[SoftStepping, Any, mujoco.MjData]:
        """The scheme in Python, the same in compiled code, and data; made on first use."""
        scheme = copy.copy(self._scheme)
        scheme.collisions = copy.copy(scheme.collisions)  # repeated steps are not counted again
        scheme.collisions.collider = self._collider
        return scheme, self._compile(scheme, warn=False), mujoco.MjData(scheme.model)

    def tell(self, rows: np.ndarray, sums: ImpactSums) -> tuple[ImpactEvent, ...]:
        """Return the collisions of steps, from rows with the state before each step and its sums.

        Args:
            rows: state before the step, and sums of compiled code, of each step.
            sums: sums over the collisions of all steps.
        """
        scheme, compiled, data = self._again
        mujoco.mj_resetData(scheme.model, data)  # results do not depend on steps that were repeated before
        by, events, misses = self._collider, [], False
        for row in rows[rows[:, -SUMS] > 0]:
            outcomes = deque(compiled.outcomes(row))
            misses |= _misses(compiled.sums(), sums_in(row[-SUMS:]))
            restore_state(scheme.model, data, row[:-SUMS])
            laws = _Known(by.law, outcomes), _Known(by.last_law, outcomes)
            scheme.collisions.collider = _KnownCollider(*laws, "allow", by.most, by.solver, outcomes, [])
            try:
                events += scheme.step(data)
            finally:
                scheme.collisions.collider = by
        # if a problem has several solutions, Python can find another one
        if misses and _misses(ImpactSums.of(events), sums):
            raise changed_model(float(data.time))
        return tuple(events)


class RepeatedStep:
    """The collisions of compiled steps; when they are read, the scheme in Python takes the steps again.

    Args:
        repeater: repeats the steps.
        rows: state before the step, and sums of compiled code, of each step.
        total: sums over the collisions of all steps.

    Attributes:
        sums: sums over the collisions, available without the events.
    """

    def __init__(self, repeater: StepRepeater, rows: np.ndarray, total: memoryview):
        self._repeater, self._rows = repeater, rows
        self.sums = sums_in(total)

    def __call__(self) -> tuple[ImpactEvent, ...]:
        """Return the collisions as events."""
        return self._events

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        return self._repeater.tell(self._rows, self.sums)


def _misses(again: ImpactSums, sums: ImpactSums) -> bool:
    """Return whether repeated steps have had other collisions than before."""
    differs = abs(again.intensity - sums.intensity) > _AGAIN * sums.intensity
    return again.collisions != sums.collisions or differs
