"""The collisions of a compiled step as events: when they are read, the step is taken again.

Once sums have been read, later steps compute their sums directly.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw.stepping.impact_event import ImpactEvent, ImpactSums, changed_model
from impactlaw.stepping.integration import STEP_STATE, restore_state
from impactlaw.stepping.time_stepping.compiled.state import memory
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY
from impactlaw.stepping.time_stepping.compiled.state.sums import SUMS
from impactlaw.stepping.time_stepping.compiled.state.surfaces import last_motion
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING
from impactlaw.stepping.time_stepping.scheme import TimeStepping
from impactlaw.stepping.time_stepping.tolerances import SLOWEST

_SAME = 1e-4  # largest deviation of the velocity after the repeated step, relative to the largest velocity


class StepRepeater:
    """Repeats steps under one law: in compiled code for sums, in Python for events."""

    def __init__(self, scheme: TimeStepping, compile: Callable[[TimeStepping], Any], settings: np.ndarray):
        self.scheme, self._compile, self._settings = scheme, compile, settings

    @cached_property
    def data(self) -> mujoco.MjData:
        """The data in which steps are repeated."""
        return mujoco.MjData(self.scheme.model)

    @cached_property
    def _steps(self) -> Any:
        return self._compile(self.scheme)

    def told(self, numbers: np.ndarray) -> ImpactSums | None:
        """Return the sums that a step has computed, if it was to; None if only events give them."""
        count, energy, own, intensity, *many = numbers[MEMORY.sums : MEMORY.sums + SUMS].tolist()
        return ImpactSums(int(count), energy, own, intensity, *map(int, many)) if count > 0.0 else None

    def sums(self, state: np.ndarray, numbers: np.ndarray, impulses: bytes) -> ImpactSums | None:
        """Return the sums over the collisions of a step; None if only events give them. Later steps compute theirs."""
        self._settings[SETTING.sums] = 1.0
        self.again(state, numbers, impulses)
        return self.told(self._steps.numbers)

    def again(self, state: np.ndarray, numbers: np.ndarray, impulses: bytes) -> np.ndarray:
        """Repeat a step in compiled code, and return the velocity after it, (nv,)."""
        steps, model, data = self._steps, self.scheme.model, self.data
        restore_state(model, data, state, STEP_STATE)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        memory.restore(steps.numbers, numbers, impulses)
        steps.numbers[MEMORY.sums] = np.nan
        steps.step(data)
        return data.qvel.copy()


class Start(NamedTuple):
    """The start of a step, and its result."""

    state: np.ndarray
    numbers: np.ndarray  # see `memory`
    impulses: bytes  # see `memory.raw`
    after: np.ndarray  # velocity after the step, (nv,)
    sums: ImpactSums | None  # sums over its collisions, if the step was to compute them


class RepeatedStep:
    """The collisions of one step; see `StepRepeater`.

    Most instances are dropped before they are read. Arrays that the next step overwrites are copied before that if the
    instance still exists.

    Args:
        repeater: repeats the step.
        owner: owner of the arrays that follow, and of the impulses of the last step.
        state: the state at the start of the step.
        before: the memory at the start of the step.
        numbers: the current memory.
        summed: whether the step has computed sums, 0.0 or 1.0.
    """

    def __init__(
        self,
        repeater: StepRepeater,
        owner: object,
        state: np.ndarray,
        before: np.ndarray,
        numbers: np.ndarray,
        summed: float,
    ):
        self._repeater, self._places, self._summed = repeater, (owner, state, before, numbers), summed

    def __call__(self) -> tuple[ImpactEvent, ...]:
        """Return the collisions as events."""
        return self._events

    @cached_property
    def start(self) -> Start:
        """The start of the step, copied on first access."""
        _, state, before, numbers = self._places
        at = MEMORY.left + self._repeater.scheme.model.nq
        after = numbers[at : at + self._repeater.scheme.model.nv].copy()
        found = self._repeater.told(numbers) if self._summed else None
        return Start(state.copy(), before.copy(), memory.raw(before), after, found)

    def __getstate__(self) -> dict[str, Any]:
        """Return the start of the step, too, for copies."""
        return {"_repeater": self._repeater, "start": self.start}

    @cached_property
    def sums(self) -> ImpactSums:
        """Sums over the collisions."""
        start = self.start
        known = start.sums or self._repeater.sums(start.state, start.numbers, start.impulses)
        return known or ImpactSums.of(self._events)

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        scheme, data, start = self._repeater.scheme, self._repeater.data, self.start
        model, kept, numbers = scheme.model, scheme.short_steps, start.numbers
        restore_state(model, data, start.state, STEP_STATE)
        counts = numbers.view(np.int64)
        begin = MEMORY.left + model.nq + model.nv
        gained = numbers[begin : begin + 2 * model.nv].reshape(2, model.nv)
        motion = last_motion(numbers, model)
        known = memory.recollect(numbers, start.impulses)
        scheme.resume(data, known, gained, motion, solved=bool(counts[MEMORY.solved]))
        told = scheme.step(data)
        scheme.short_steps = kept
        time, events = float(data.time), told() if callable(told) else told
        # if a problem has several solutions, Python may find another one
        if self._misses(data.qvel) and self._misses(self._repeater.again(start.state, numbers, start.impulses)):
            raise changed_model(time)
        return events

    def _misses(self, velocity: np.ndarray) -> bool:
        """Return whether the repeated step has led to another velocity than before."""
        after = self.start.after
        return bool(np.abs(velocity - after).max() > _SAME * max(SLOWEST, np.abs(after).max()))
