"""The collisions of a step as events: when they are read, the step is taken again.

Once sums have been read, later steps compute their sums directly.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw.scratch import Scratch
from impactlaw.stepping.impact_event import ImpactEvent, ImpactSums, LazyEvents, changed_model
from impactlaw.stepping.integration import STEP_STATE, restore_state
from impactlaw.stepping.time_stepping.compiled.state import memory
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY
from impactlaw.stepping.time_stepping.compiled.state.room import SUMS
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING
from impactlaw.stepping.time_stepping.law_in_scene import LawInScene
from impactlaw.stepping.time_stepping.tolerances import SLOWEST

_SAME = 1e-4  # largest deviation of the velocity after the repeated step, relative to the largest velocity


class StepRepeater:
    """Repeats steps under one law.

    Args:
        law: the law in the scene.
        make: makes the `scheme.TimeStepping` of a law.
        settings: the settings of the steps to be repeated, `compiled.state.world.Settings`.
    """

    def __init__(self, law: LawInScene, make: Callable[[LawInScene], Any], settings: np.ndarray):
        self.law, self._make, self._settings = law, make, settings
        self._scratch = Scratch(law.model)

    @cached_property
    def _steps(self) -> Any:
        return self._make(self.law)

    def told(self, numbers: np.ndarray) -> ImpactSums | None:
        """Return the sums that a step has computed, if it was to; None if only events give them."""
        count, energy, own, intensity, *many = numbers[MEMORY.sums : MEMORY.sums + SUMS].tolist()
        return ImpactSums(int(count), energy, own, intensity, *map(int, many)) if count > 0.0 else None

    def sums(self, start: Start) -> ImpactSums | None:
        """Return the sums over the collisions of a step; None if only events give them. Later steps compute theirs."""
        self._settings[SETTING.sums] = 1.0
        self._again(start)
        return self.told(self._steps.numbers)

    def events(self, start: Start) -> tuple[ImpactEvent, ...]:
        """Return the collisions of a step."""
        steps, after = self._steps, start.after
        steps.keep_collisions(True)
        try:
            told = self._again(start)
        finally:
            steps.keep_collisions(False)
        data = self._scratch.data
        if np.abs(data.qvel - after).max() > _SAME * max(SLOWEST, np.abs(after).max()):
            raise changed_model(float(data.time))
        return told() if callable(told) else told

    def _again(self, start: Start) -> LazyEvents:
        """Repeat a step, and return its collisions if they are kept."""
        steps, model, data = self._steps, self.law.model, self._scratch.data
        restore_state(model, data, start.state, STEP_STATE)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        memory.restore(steps.numbers, start.numbers, start.impulses)
        steps.numbers[MEMORY.sums] = np.nan
        return steps.step(data)


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
        at = MEMORY.left + self._repeater.law.model.nq
        after = numbers[at : at + self._repeater.law.model.nv].copy()
        found = self._repeater.told(numbers) if self._summed else None
        return Start(state.copy(), before.copy(), memory.raw(before), after, found)

    def __getstate__(self) -> dict[str, Any]:
        """Return the start of the step, too, for copies."""
        return {"_repeater": self._repeater, "start": self.start}

    @cached_property
    def sums(self) -> ImpactSums:
        """Sums over the collisions."""
        return self.start.sums or self._repeater.sums(self.start) or ImpactSums.of(self._events)

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        return self._repeater.events(self.start)
