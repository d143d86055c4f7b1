"""The collisions of a compiled step as events: when somebody asks for them, the step is taken once more.

Where sums were asked for, the steps that follow find theirs at once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

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

    @property
    def finds_sums(self) -> bool:
        """Whether steps are to find sums from now on."""
        return bool(self._settings[SETTING.told])

    def told(self, numbers: np.ndarray) -> ImpactSums | None:
        """Return the sums that a step has found, which was to; None where only events tell."""
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


class Start(NamedTuple):
    """What a step began with, and what it came to."""

    state: np.ndarray
    numbers: np.ndarray  # see `memory`
    impulses: bytes  # see `memory.raw`
    after: np.ndarray  # velocity that it led to, (nv,)
    sums: ImpactSums | None  # over its collisions, if it was to find them


class Replay:
    """The collisions of one step; see `Teller`.

    Most are dropped unasked: what the next step overwrites is copied by then, if anybody still has this.

    Args:
        teller: takes the step once more.
        owner: of the arrays that follow, and of the impulses of the step before.
        state: that the step began with.
        before: what was known then.
        numbers: what is known now.
    """

    def __init__(self, teller: Teller, owner: object, state: np.ndarray, before: np.ndarray, numbers: np.ndarray):
        self._teller, self._places, self._summed = teller, (owner, state, before, numbers), teller.finds_sums

    def __call__(self) -> tuple[ImpactEvent, ...]:
        """Return them as events."""
        return self._events

    @cached_property
    def start(self) -> Start:
        """What it began with, copied when this is first asked for."""
        _, state, before, numbers = self._places
        at = MEMORY.left + self._teller.scheme.model.nq
        after = numbers[at : at + self._teller.scheme.model.nv].copy()
        found = self._teller.told(numbers) if self._summed else None
        return Start(state.copy(), before.copy(), memory.raw(before), after, found)

    def __getstate__(self) -> dict[str, Any]:
        """A copy has what the step began with."""
        return {"_teller": self._teller, "start": self.start}

    @cached_property
    def sums(self) -> ImpactSums:
        """Sums over them."""
        start = self.start
        known = start.sums or self._teller.sums(start.state, start.numbers, start.impulses)
        return known or ImpactSums.of(self._events)

    @cached_property
    def _events(self) -> tuple[ImpactEvent, ...]:
        scheme, data, start = self._teller.scheme, self._teller.data, self.start
        model, kept, numbers = scheme.model, scheme.short_steps, start.numbers
        restore_state(model, data, start.state)
        counts = numbers.view(np.int64)
        begin = MEMORY.left + model.nq + model.nv
        gained = numbers[begin : begin + 2 * model.nv].reshape(2, model.nv)
        motion = last_motion(numbers, model)
        known = memory.recollect(numbers, start.impulses)
        scheme.resume(data, known, gained, motion, solved=bool(counts[MEMORY.solved]))
        told = scheme.step(data)
        scheme.short_steps = kept
        time, events = float(data.time), told() if callable(told) else told
        # where a problem has several solutions, Python's can be another one
        if self._misses(data.qvel) and self._misses(self._teller.again(start.state, numbers, start.impulses)):
            raise changed_model(time)
        return events

    def _misses(self, velocity: np.ndarray) -> bool:
        """Return whether the step, once more, has led to another velocity than before."""
        after = self.start.after
        return bool(np.abs(velocity - after).max() > _SAME * max(SLOWEST, np.abs(after).max()))
