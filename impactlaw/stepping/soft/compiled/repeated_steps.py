"""The collisions of compiled steps: sums at once, events when they are read."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import SolverError
from impactlaw.laws import Coulomb, Law, Target
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.mechanics.impact import Impact
from impactlaw.solvers.friction.solve import THOROUGH
from impactlaw.stepping.collisions import as_closed, is_kept
from impactlaw.stepping.impact_event import ImpactEvent, ImpactSums, changed_model
from impactlaw.stepping.integration import restore_state
from impactlaw.stepping.soft.compiled.collide import SUMS
from impactlaw.stepping.soft.scheme import SoftStepping

_AGAIN = 1e-4  # largest deviation of the intensity of repeated collisions, relative to the intensity
_SAME = 1e-9  # largest difference between two outcomes of a law that are the same, relative to the largest velocity


class _AsCompiled:
    """No limit of work, but restitution is omitted where compiled code omits it; see `Effort`."""

    hasty = True

    def rounds(self, rows: int) -> int:
        """Return the largest number of rounds."""
        return THOROUGH

    def steps(self, rows: int) -> float:
        """Return infinity: there is no limit."""
        return np.inf

    def attempt(self, rows: int, steps: int) -> None:
        """Do nothing."""

    def begin_part(self) -> None:
        """Do nothing."""


@dataclass(frozen=True)
class _Known(Law):
    """A law with known outcomes: where friction is indeterminate, another solution of the law could be found."""

    law: Law
    velocities: Iterator[np.ndarray]
    closed: bool = False  # see `as_closed`

    def target(self, collision: Collision) -> Target:
        """Return the target of the law."""
        return self.law.target(collision)

    def resolve(self, collision: Collision, *, solver: str = "auto") -> Impact:
        """Return the impact with the next known velocity."""
        limits = {"effort": _AsCompiled()} if isinstance(self.law, Coulomb) else {}
        impact = self.law.resolve(collision, solver=solver, **limits)
        if self.closed and not is_kept(impact):
            return impact  # compiled code has not used this outcome, either
        velocity = next(self.velocities, None)
        if velocity is None:
            return impact
        if np.abs(impact.post_velocity - velocity).max() <= _SAME * np.abs(velocity).max():
            return replace(impact, post_velocity=velocity)
        kept: dict[str, Any] = {"target_contact_velocity": impact.target_contact_velocity}
        try:
            if not isinstance(impact, FrictionImpact):
                return replace(Impact.observed(collision, velocity), **kept)
            for name in ("target_sliding_velocity", "exact", "restitution_scale"):
                kept[name] = getattr(impact, name)
            return replace(FrictionImpact.observed(collision, velocity, near=impact), **kept)
        except SolverError:
            return impact


@as_closed.register
def _(law: _Known) -> Law:
    return _Known(as_closed(law.law), law.velocities, closed=True)


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
            velocities = iter(compiled.outcomes(row))
            misses |= _misses(compiled.sums(), sums_in(row[-SUMS:]))
            restore_state(scheme.model, data, row[:-SUMS])
            known = replace(
                by, law=_Known(by.law, velocities), last_law=_Known(by.last_law, velocities), on_inadmissible="allow"
            )  # compiled code has judged these outcomes; impulses that are fitted to them here are less accurate
            scheme.collisions.collider = known
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
