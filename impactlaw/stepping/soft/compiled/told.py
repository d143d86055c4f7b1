"""What compiled steps tell of their collisions: sums at once, events when somebody asks."""

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

_AGAIN = 1e-4  # part of their intensity by which collisions that are told may have another one
_SAME = 1e-9  # part of the largest velocity by which two outcomes of a law may differ and be the same


class _AsCompiled:
    """No limit of work, but restitution is left out where compiled code leaves it out; see `Effort`."""

    hasty = True

    def rounds(self, rows: int) -> int:
        """Return all."""
        return THOROUGH

    def steps(self, rows: int) -> float:
        """Return that there is no limit."""
        return np.inf

    def attempt(self, rows: int, steps: int) -> None:
        """Let it be."""

    def begin_part(self) -> None:
        """Let it be."""


@dataclass(frozen=True)
class _Known(Law):
    """A law whose outcomes are known, since it has several solutions where friction is indeterminate."""

    law: Law
    velocities: Iterator[np.ndarray]
    closed: bool = False  # see `as_closed`

    def target(self, collision: Collision) -> Target:
        """Return the target of the law."""
        return self.law.target(collision)

    def resolve(self, collision: Collision, *, solver: str = "auto") -> Impact:
        """Return the impact with the velocity that is known."""
        limits = {"effort": _AsCompiled()} if isinstance(self.law, Coulomb) else {}
        impact = self.law.resolve(collision, solver=solver, **limits)
        if self.closed and not is_kept(impact):
            return impact  # compiled code has gone on without it, too
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
    """Return the sums that compiled steps have found."""
    count, energy, intensity, distant, scaled, _, _, work = found
    return ImpactSums(int(count), energy, work, intensity, int(distant), int(scaled))


class Teller:
    """Takes steps of a scheme once more, under the law that it has now; what that needs is made when it is first asked.

    Args:
        scheme: in Python.
        compile: makes compiled steps of a scheme, which tell the outcomes of their collisions.
    """

    def __init__(self, scheme: SoftStepping, compile: Callable[..., Any]):
        self._scheme, self._collider, self._compile = scheme, scheme.collisions.collider, compile

    @cached_property
    def _again(self) -> tuple[SoftStepping, Any, mujoco.MjData]:
        """The scheme in Python and compiled, and data."""
        scheme = copy.copy(self._scheme)
        scheme.collisions = copy.copy(scheme.collisions)  # what is told once more is not counted once more
        scheme.collisions.collider = self._collider
        return scheme, self._compile(scheme, warn=False), mujoco.MjData(scheme.model)

    def tell(self, rows: np.ndarray, sums: ImpactSums) -> tuple[ImpactEvent, ...]:
        """Return the collisions of steps, from states before them and what compiled code keeps of each."""
        scheme, compiled, data = self._again
        mujoco.mj_resetData(scheme.model, data)  # what is told does not depend on what was told before
        by, events, misses = self._collider, [], False
        for row in rows[rows[:, -SUMS] > 0]:
            velocities = iter(compiled.outcomes(row))
            misses |= _misses(compiled.sums(), sums_in(row[-SUMS:]))
            restore_state(scheme.model, data, row[:-SUMS])
            known = replace(
                by, law=_Known(by.law, velocities), last_law=_Known(by.last_law, velocities), on_inadmissible="allow"
            )  # compiled code has judged them: impulses that are fitted here to large ones are less sharp
            scheme.collisions.collider = known
            try:
                events += scheme.step(data)
            finally:
                scheme.collisions.collider = by
        # where a problem has several solutions, Python's can be another one
        if misses and _misses(ImpactSums.of(events), sums):
            raise changed_model(float(data.time))
        return tuple(events)


class Replay:
    """The collisions of compiled steps, told by the scheme in Python when somebody asks: it takes them once more.

    Args:
        teller: takes them.
        rows: states before the steps, and what compiled code keeps of each.
        total: sums over the collisions.

    Attributes:
        sums: over the collisions; they need no events.
    """

    def __init__(self, teller: Teller, rows: np.ndarray, total: memoryview):
        self._teller, self._rows = teller, rows
        self.sums = sums_in(total)

    def __call__(self) -> tuple[ImpactEvent, ...]:
        """Return them as events."""
        return self._events

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        return self._teller.tell(self._rows, self.sums)


def _misses(again: ImpactSums, sums: ImpactSums) -> bool:
    """Return whether steps, once more, have had other collisions than before."""
    differs = abs(again.intensity - sums.intensity) > _AGAIN * sums.intensity
    return again.collisions != sums.collisions or differs
