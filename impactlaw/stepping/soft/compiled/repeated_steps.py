"""The collisions of compiled steps: sums at once, events when they are read.

Compiled code then takes a step again, and writes the outcomes of its collisions.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from itertools import groupby
from operator import attrgetter
from typing import Any

import mujoco
import numpy as np

from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact, cone_problem
from impactlaw.mechanics.impact import Impact
from impactlaw.scene.contacts import first_rows
from impactlaw.scratch import Scratch
from impactlaw.solvers.certificate import judge
from impactlaw.solvers.friction.problem import ConeAnswer
from impactlaw.solvers.friction.solve import shared
from impactlaw.solvers.problem import Problem, Status
from impactlaw.stepping.impact_event import ImpactEvent, ImpactSums, changed_model, sums_of
from impactlaw.stepping.integration import STEP_STATE, restore_state
from impactlaw.stepping.soft.collisions import Collisions
from impactlaw.stepping.soft.compiled.collide import SUMS
from impactlaw.stepping.soft.compiled.contacts.outcomes import Outcome
from impactlaw.stepping.soft.scheme import SoftStepping

_AGAIN = 1e-4  # largest deviation of the intensity of repeated collisions, relative to the intensity
_SAME = 1e-9  # largest difference between jumps by impulses that are the same, relative to the largest velocity


def sums_in(found: Iterable[float]) -> ImpactSums:
    """Return the sums that compiled steps have computed."""
    count, energy, intensity, distant, scaled, _, _, work = found
    return ImpactSums(int(count), energy, work, intensity, int(distant), int(scaled))


def _events_of(outcomes: list[Outcome], collisions: Collisions, data: mujoco.MjData) -> Iterator[ImpactEvent]:
    """Yield the collisions of one instant as events; before, data is at the start of the step."""
    model, first = collisions.model, outcomes[0]
    data.time, data.qpos[:], data.qvel[:] = first.time, first.qpos, first.before
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    closed, metric, row = collisions.closed(data), collisions.metric(data), first_rows(model, data)
    if data.ne:
        kept = np.where(np.isnan(first.impulse[: data.ne]), -1.0, np.inf)
        closed = closed._replace(bilateral=collisions.bilateral_rows(data, kept))
    for outcome in outcomes:
        part = np.flatnonzero(~np.isnan(outcome.impulse[row]))
        some = closed.select(part)
        impact = _impact(some.collision(metric, outcome.before).without_idle_friction, outcome, row[part])
        yield ImpactEvent(outcome.time, some.contacts, impact, outcome.qpos.copy())


def _impact(collision: Collision, outcome: Outcome, row: np.ndarray) -> Impact:
    """Return the impact with an outcome, for the first row of each contact; redundant contacts share impulses."""
    velocity, jump = outcome.before + outcome.jump, collision.metric.whiten(outcome.jump)
    friction, h = collision.friction, len(row)
    if friction is None or not len(friction):
        problem = Problem(
            collision.whitened_jacobian, outcome.wanted[row] - collision.pre_contact_velocity, speed=collision.pre_speed
        )
        answer = judge(problem, outcome.impulse[row], jump)
        return replace(Impact.solved(collision, problem, answer, outcome.wanted[row]), post_velocity=velocity)
    order, sizes = collision.cone_rows
    rows = np.arange(len(order)) + np.repeat(row - (np.cumsum(sizes) - sizes), sizes)
    impulse, wanted = outcome.impulse[rows], np.empty(len(order))
    wanted[order] = outcome.wanted[rows]
    targets = wanted[:h], wanted[h:] / friction.coefficient
    problem = cone_problem(collision, *targets, exact=outcome.exact)
    if problem.is_redundant:
        x = problem.scaled(impulse)
        residual = problem.residual(x, problem.velocity(x))
        least = shared(problem, ConeAnswer(impulse, jump, residual, Status.SOLVED, 0))
        if np.abs(least.jump - jump).max() <= _SAME * np.abs(jump).max():  # else it is another solution
            impulse = least.impulse
    known: dict[str, Any] = {"restitution_scale": outcome.share, "exact": outcome.exact, "cones": problem}
    return replace(FrictionImpact.of_cones(collision, impulse, jump, targets, **known), post_velocity=velocity)


class StepRepeater:
    """Repeats steps of a scheme, under the law that it has when this is made.

    Args:
        scheme: the scheme in Python.
        compile: makes the compiled stepping of a scheme, which computes the outcomes of collisions.
    """

    def __init__(self, scheme: SoftStepping, compile: Callable[..., Any]):
        self._scheme, self._collider, self._compile = scheme, scheme.collisions.collider, compile

    @cached_property
    def _again(self) -> tuple[Any, Collisions, Scratch]:
        """The compiled stepping of the scheme, its collisions, and other data; made on first use."""
        scheme = copy.copy(self._scheme)
        scheme.collisions = copy.copy(scheme.collisions)  # repeated steps are not counted again
        scheme.collisions.collider = self._collider
        scheme.collisions.surfaces = copy.copy(scheme.collisions.surfaces)
        return self._compile(scheme, warn=False), scheme.collisions, Scratch(scheme.model)

    def tell(self, rows: np.ndarray) -> tuple[ImpactEvent, ...]:
        """Return the collisions of steps.

        Args:
            rows: state before the step, and sums of compiled code, of each step.
        """
        compiled, collisions, scratch = self._again
        data = scratch.data
        events: list[ImpactEvent] = []
        for row in rows[rows[:, -SUMS] > 0]:
            again, outcomes = compiled.repeat(row, data)
            if _misses(sums_of(again), sums_in(row[-SUMS:])):
                raise changed_model(float(data.time))
            if isinstance(again, tuple):  # in Python, as a callback has been set
                events += again
            restore_state(collisions.model, data, row[:-SUMS], STEP_STATE)
            for _, some in groupby(outcomes, attrgetter("time")):  # RK4 collides at the start and at the end of a step
                events += _events_of(list(some), collisions, data)
        return tuple(events)


class RepeatedStep:
    """The collisions of compiled steps; when they are read, these steps are taken again.

    Args:
        repeater: repeats the steps.
        rows: state before the step, and sums of compiled code, of each step.
        total: sums over the collisions of all steps.

    Attributes:
        sums: sums over the collisions, available without the events.
    """

    def __init__(self, repeater: StepRepeater, rows: np.ndarray, total: Iterable[float]):
        self._repeater, self._rows, self.sums = repeater, rows, sums_in(total)

    def __call__(self) -> tuple[ImpactEvent, ...]:
        """Return the collisions as events."""
        return self._events

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        return self._repeater.tell(self._rows)


def _misses(again: ImpactSums, sums: ImpactSums) -> bool:
    """Return whether repeated steps have had other collisions than before."""
    differs = abs(again.intensity - sums.intensity) > _AGAIN * sums.intensity
    return again.collisions != sums.collisions or differs
