"""The collisions of a compiled step as events: when somebody asks for them, the step is taken once more.

Where sums were asked for, the steps that follow find theirs at once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from impactlaw.stepping.impact_event import ImpactEvent, ImpactSums, changed_model
from impactlaw.stepping.integration import restore_state
from impactlaw.stepping.time_stepping.compiled.state import memory
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY
from impactlaw.stepping.time_stepping.compiled.state.sums import SUMS
from impactlaw.stepping.time_stepping.compiled.state.surfaces import last_motion
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING
from impactlaw.stepping.time_stepping.scheme import TimeStepping
from impactlaw.stepping.time_stepping.tolerances import SLOWEST

_SAME = 1e-4  # part of the largest velocity by which the step once more may end with another one


class Teller:
    """Takes the steps of one law once more: in compiled code for sums, in Python for events."""

    def __init__(self, scheme: TimeStepping, compile: Callable[[TimeStepping], Any], settings: np.ndarray):
        self.scheme, self._compile, self._settings = scheme, compile, settings

    @cached_property
    def data(self) -> mujoco.MjData:
        """Where steps are taken once more."""
        return mujoco.MjData(self.scheme.model)

    @cached_property
    def _steps(self) -> Any:
        return self._compile(self.scheme)

    def tell(self, state: np.ndarray, before: np.ndarray, numbers: np.ndarray) -> Replay:
        """Return what tells the collision of a step from its start, what was known then, and what is known now."""
        begin, model = MEMORY.left, self.scheme.model
        return Replay(
            self, state, before, numbers[begin + model.nq : begin + model.nq + model.nv].copy(), self.told(numbers)
        )

    def told(self, numbers: np.ndarray) -> ImpactSums | None:
        """Return the sums that a step has found; None if it was not to, or where only events tell."""
        if not self._settings[SETTING.told]:
            return None
        count, energy, intensity, *many = numbers[MEMORY.sums : MEMORY.sums + SUMS].tolist()
        return ImpactSums(int(count), energy, 0.0, intensity, *map(int, many)) if count > 0.0 else None

    def sums(self, state: np.ndarray, numbers: np.ndarray, impulses: bytes) -> ImpactSums | None:
        """Return the sums over the collisions of a step; None where only events tell. Later steps find theirs."""
        self._settings[SETTING.told] = 1.0
        self.again(state, numbers, impulses)
        return self.told(self._steps.numbers)

    def again(self, state: np.ndarray, numbers: np.ndarray, impulses: bytes) -> np.ndarray:
        """Take a step once more in compiled code, and return the velocity that it leads to, (nv,)."""
        steps, model, data = self._steps, self.scheme.model, self.data
        restore_state(model, data, state)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        memory.restore(steps.numbers, numbers, impulses)
        steps.numbers[MEMORY.sums] = np.nan
        steps.step(data)
        return data.qvel.copy()


class Replay:
    """The collisions of one step; see `Teller`."""

    def __init__(
        self, teller: Teller, state: np.ndarray, numbers: np.ndarray, after: np.ndarray, found: ImpactSums | None
    ):
        self._teller, self._state, self._numbers, self._after, self._found = teller, state, numbers, after, found
        self._impulses = memory.raw(numbers)

    def __call__(self) -> tuple[ImpactEvent, ...]:
        """Return them as events."""
        return self._events

    @cached_property
    def sums(self) -> ImpactSums:
        """Sums over them."""
        known = self._found or self._teller.sums(self._state, self._numbers, self._impulses)
        return known or ImpactSums.of(self._events)

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        scheme, data = self._teller.scheme, self._teller.data
        model, kept = scheme.model, scheme.short_steps
        restore_state(model, data, self._state)
        counts = self._numbers.view(np.int64)
        begin = MEMORY.left + model.nq + model.nv
        gained = self._numbers[begin : begin + 2 * model.nv].reshape(2, model.nv)
        motion = last_motion(self._numbers, model)
        known = memory.recollect(self._numbers, self._impulses)
        scheme.resume(data, known, gained, motion, solved=bool(counts[MEMORY.solved]))
        told = scheme.step(data)
        scheme.short_steps = kept
        time, events = float(data.time), told() if callable(told) else told
        # where a problem has several solutions, Python's can be another one
        if self._misses(data.qvel) and self._misses(self._teller.again(self._state, self._numbers, self._impulses)):
            raise changed_model(time)
        return events

    def _misses(self, velocity: np.ndarray) -> bool:
        """Return whether the step, once more, has led to another velocity than before."""
        return bool(np.abs(velocity - self._after).max() > _SAME * max(SLOWEST, np.abs(self._after).max()))
