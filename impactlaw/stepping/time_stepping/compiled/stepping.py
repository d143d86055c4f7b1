"""Time stepping of one world in compiled code; steps that it does not cover are taken by the scheme in Python."""

from __future__ import annotations

import copy
import weakref
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import DivergenceError
from impactlaw.laws import Law
from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.solvers import load_solvers
from impactlaw.stepping.compatibility import refuse_override
from impactlaw.stepping.compiled.engine import when_gone
from impactlaw.stepping.compiled.fields import SIZE
from impactlaw.stepping.compiled.one_world import OneWorld
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.integration import STEP_STATE, check_input, check_timestep, empty_state
from impactlaw.stepping.time_stepping.compiled.entry import CONTEXT, single
from impactlaw.stepping.time_stepping.compiled.model_copy import room
from impactlaw.stepping.time_stepping.compiled.repeated_steps import RepeatedStep, StepRepeater
from impactlaw.stepping.time_stepping.compiled.state import memory, status
from impactlaw.stepping.time_stepping.compiled.state.law import reason
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY
from impactlaw.stepping.time_stepping.compiled.state.surfaces import last_motion, put_motion
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING
from impactlaw.stepping.time_stepping.scheme import TimeStepping

_COLLIDED, _SUMS = MEMORY.collided, SETTING.sums


class CompiledStepping(OneWorld):
    """Time stepping in compiled code, with the interface of `scheme.TimeStepping`; see there."""

    def __init__(self, scheme: TimeStepping, *, warn: bool, sums: bool = False):
        model: Any = scheme.model
        super().__init__(model, single.address, CONTEXT, warn=warn)
        self._scheme, self._sums = scheme, float(sums)
        self._memory = memory.make_memory(model, 1)
        when_gone(self, memory.free, self._memory)
        self._before, self.numbers = np.zeros(self._memory.shape[1]), self._memory[0]
        self._counts, self._told = self.numbers.view(np.int64), memoryview(self.numbers.data)
        self.unlocated = 0
        self._replay: weakref.ref[RepeatedStep] | None = None  # the last collision
        self._structure, self._state = np.zeros(int(self._table[SIZE.model]) // 8), empty_state(model, STEP_STATE)
        self._margins, self._settings = np.zeros(room(model)), np.zeros(len(SETTING))
        self._options = memoryview(self._settings.data)
        self._carriers, self._bilateral, self._scratch = scheme.carriers, constraint_kinds(model), mujoco.MjData(model)
        self._take_over()

    def _take_over(self) -> None:
        """Adopt the law and the options of the scheme."""
        targets = self._scheme.problem.targets
        self._coefficients, self._reason = self._scheme.coefficients(), reason(targets, self._model)
        sums = max(self._sums, self._settings[SETTING.sums])
        self._settings[:] = self._scheme.settings()
        self._settings[SETTING.sums] = sums
        self._inertial = self._scheme.inertial
        self._repeater = StepRepeater(self._scheme, _with_sums, self._settings)
        self._write_context()
        if self._reason is not None:
            load_solvers()
            self._tell(self._reason)

    def _write_context(self) -> None:
        """Write addresses and sizes of all arrays for compiled code."""
        scratch: Any = self._scratch
        arrays = {
            "settings": self._settings, "carriers": self._carriers, "bilateral": self._bilateral,
            "memory": self._memory, "structure": self._structure, "margins": self._margins, "state": self._state,
            "before": self._before,
        }  # fmt: skip
        numbers = {
            "scratch": scratch._address, "memories": self._memory.shape[1], "margin_count": len(self._margins),
            "states": len(self._state),
        }  # fmt: skip
        self._fill_context(arrays, numbers)

    @property
    def shortfall(self) -> float:
        """See `scheme.TimeStepping`, like the following attributes."""
        return float(self.numbers[MEMORY.shortfall])

    @property
    def short_steps(self) -> int:
        """Number of short steps of compiled code and of the scheme in Python."""
        return int(self.numbers[MEMORY.short_steps]) + self._scheme.short_steps

    @property
    def solved(self) -> bool:
        """Whether the last step with contact has met the law."""
        return bool(self._counts[MEMORY.solved])

    def set_law(self, law: Law) -> None:
        """Use another law for the collisions of the next steps."""
        self._scheme = copy.copy(self._scheme)  # collisions that have not been read yet follow the old law
        self._scheme.set_law(law)
        self._take_over()

    def step(self, data: mujoco.MjData) -> Callable[[], tuple[ImpactEvent, ...]] | tuple[()]:
        """Advance by one timestep; return a function for its collisions, or (). After an error, data is as before."""
        if self._replay is not None and (replay := self._replay()) is not None:
            _ = replay.start  # copies what the step overwrites
        entry = self._opened()
        if entry is None:
            return self._in_python(data)
        if not self._inertial.act and self._inertial.look():
            self._settings[SETTING.inertial] = 1.0
        world: Any = data
        while (how := entry.call(world._address)) != status.FINE:
            if how < 0:
                self._fail(data, self._state, entry.message)
            if how == status.CALLBACK:
                self._tell_of_callback()
                return self._in_python(data)
            if how != status.UNKNOWN:
                raise self._error(how, data)
            self._coefficients.learn(self._fields[CONTEXT.asked])
            self._write_context()
        if not self._told[_COLLIDED]:
            return ()
        summed = self._options[_SUMS]
        replay = RepeatedStep(self._repeater, self, self._state, self._before, self.numbers, summed)
        self._replay = weakref.ref(replay)
        return replay

    def _in_python(self, data: mujoco.MjData) -> Callable[[], tuple[ImpactEvent, ...]] | tuple[()]:
        self._counts[MEMORY.known] = 0
        self._scheme.move_on(last_motion(self.numbers, self._model))
        events = self._scheme.step(data)
        put_motion(self.numbers, self._model, self._scheme.last_motion)
        self.numbers[MEMORY.shortfall], self._counts[MEMORY.solved] = self._scheme.shortfall, self._scheme.solved
        return events

    def _error(self, how: int, data: mujoco.MjData) -> Exception:
        """Return the error of a step that has ended like this."""
        if how == status.TIMESTEP:
            check_timestep(self._model.opt.timestep)
        if how == status.OVERRIDDEN:
            refuse_override(self._model)
        if how == status.HUGE_INPUT:
            check_input(self._model, data, self._state)
        if how == status.CREATES:
            return self._scheme.problem.inadmissible(float(self.numbers[MEMORY.created]), data.time)
        if how == status.NOT_FINITE:
            return DivergenceError(f"the forces at t = {data.time:.6g} s are not finite")
        return DivergenceError(f"position or velocity is not finite, or huge, at t = {data.time:.6g} s")

    def __getstate__(self) -> dict[str, Any]:
        """Return the memory, too, so that a copy continues from it."""
        given = {"scheme": self._scheme, "warn": self._warn, "sums": bool(self._sums)}
        return given | {"numbers": self.numbers.copy(), "known": memory.raw(self.numbers)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Continue from the memory of the original."""
        self.__init__(state["scheme"], warn=state["warn"], sums=state["sums"])
        memory.restore(self.numbers, state["numbers"], state["known"])


def _with_sums(scheme: TimeStepping) -> CompiledStepping:
    return CompiledStepping(scheme, warn=False, sums=True)
