"""Soft stepping of one world in compiled code; steps that it does not cover are taken by the scheme in Python."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import DivergenceError, warn_of_python
from impactlaw.laws import Law
from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.stepping.compiled.engine import Entry
from impactlaw.stepping.compiled.libmujoco import is_called_back
from impactlaw.stepping.compiled.one_world import OneWorld
from impactlaw.stepping.impact_event import ImpactEvent, LazyEvents, together
from impactlaw.stepping.integration import STEP_STATE, empty_state, restore_state
from impactlaw.stepping.soft.compiled import world
from impactlaw.stepping.soft.compiled.collide import COUNT, LAST, SHORT, SUMS
from impactlaw.stepping.soft.compiled.contacts.outcomes import Outcome, outcomes_in
from impactlaw.stepping.soft.compiled.entry import CONTEXT, TOTAL, entry
from impactlaw.stepping.soft.compiled.law import coefficients, reason, settings
from impactlaw.stepping.soft.compiled.repeated_steps import RepeatedStep, StepRepeater
from impactlaw.stepping.soft.compiled.world import SETTING
from impactlaw.stepping.soft.scheme import SoftStepping

_STEPS, _TAKEN, _STATUS = CONTEXT.steps, CONTEXT.taken, CONTEXT.status
_CALLED_BACK = "a callback of MuJoCo is set"
_ROOM = 1_000_000  # numbers that tell the collisions of almost any step


class CompiledSoftStepping(OneWorld):
    """Soft stepping in compiled code, with the interface of `scheme.SoftStepping`; see there.

    Args:
        scheme: the scheme in Python, which holds the options, and takes the steps that compiled code does not cover.
        warn: whether to warn of steps in Python.
    """

    def __init__(self, scheme: SoftStepping, *, warn: bool):
        model: Any = scheme.model
        super().__init__(model, entry.address, CONTEXT)
        self._scheme, self._warn, self._trial = scheme, warn, mujoco.MjData(model)
        self._room, self._steps = len(empty_state(model, STEP_STATE)), 0
        self._states = np.zeros((1, self._room + SUMS))
        given = scheme.collisions.given_speed
        self._numbers = np.array([np.nan, 0.0, np.nan if given is None else given, *np.zeros(SUMS)])
        self._total = memoryview(self._numbers.data)[TOTAL:]
        kept = scheme.collisions.bilateral
        self._bilateral = constraint_kinds(model) if kept.any() else np.zeros(0, np.uint8)
        self._take_over()

    def _take_over(self) -> None:
        """Adopt the law of the scheme."""
        scheme = self._scheme
        self._coefficients, self._reason = coefficients(scheme), reason(scheme)
        self._settings, self._repeater = settings(scheme), StepRepeater(scheme, CompiledSoftStepping)
        self._numbers[:2] = self._settings[SETTING.restitution], self._settings[SETTING.sliding]
        self._write_context()
        if self._reason is not None:
            self._tell(self._reason)

    def _tell(self, why: str) -> None:
        """Warn of steps in Python, once."""
        if self._warn:
            self._warn = False
            warn_of_python(why)

    def _opened(self) -> Entry | None:
        """Return the entry into compiled code; None if steps are in Python, under this law or by MuJoCo's callbacks."""
        if self._reason is not None:
            return None
        if self._entry is None and is_called_back():
            self._tell(_CALLED_BACK)
            return None
        return self._entry or self._open()

    def _write_context(self) -> None:
        """Write the addresses of the inputs of compiled code."""
        trial: Any = self._trial
        arrays = {"numbers": self._numbers, "states": self._states, "bilateral": self._bilateral}
        numbers = {
            "trial": trial._address, "exact": self._settings[SETTING.exact],
            "last_exact": self._settings[SETTING.last_exact], "frictional": self._scheme.collisions.friction,
            "most": self._settings[SETTING.most], "collides": self._scheme.collides, "state_size": self._room,
            "constraints": len(self._bilateral),
        }  # fmt: skip
        self._fill_context(arrays, numbers)

    @property
    def unlocated(self) -> int:
        """See `scheme.SoftStepping`."""
        return self._scheme.unlocated

    @property
    def short_steps(self) -> int:
        """See `scheme.SoftStepping`; steps in compiled code and in Python are counted together."""
        return self._scheme.short_steps

    def set_law(self, law: Law) -> None:
        """Use another law for the collisions of the next steps."""
        self._scheme.set_law(law)
        self._take_over()

    def finish(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        """Take the part of a step that follows `mj_step1`, in Python, and return the collisions."""
        return self._scheme.finish(data)

    def step(self, data: mujoco.MjData, steps: int = 1) -> LazyEvents:
        """Advance by a number of timesteps, 1 or more, and return their collisions, to be resolved on demand."""
        parts: list[LazyEvents] = []
        surfaces = self._scheme.collisions.surfaces
        if surfaces is None or self._reason is not None:
            self._take(data, steps, parts)
        else:
            self._beside_surfaces(surfaces, data, steps, parts)
        return together(parts) if parts else ()

    def _beside_surfaces(self, surfaces: Surfaces, data: mujoco.MjData, steps: int, parts: list[LazyEvents]) -> None:
        """Take steps in compiled code as soon as no mocap body moves any more."""
        while steps and not surfaces.stay(data):
            self._tell("mocap bodies that touch others move as surfaces")
            self._in_python(data, 1, parts)
            steps -= 1
        if steps:
            self._take(data, steps, parts)
            surfaces.end_there(data)

    def _take(self, data: mujoco.MjData, steps: int, parts: list[LazyEvents]) -> None:
        """Take a number of steps, and add their collisions."""
        opened, simulation = self._opened(), data
        if opened is None:
            self._in_python(data, steps, parts)
            return
        if steps != self._steps:
            self._ask_for(steps)
        while news := opened.call(simulation._address):  # pyright: ignore[reportAttributeAccessIssue]
            if news < 0:
                self._fail(data, self._states[self._fields[_TAKEN], : self._room], opened.message)
            steps -= self._listen(data, steps, parts)
            if not steps:
                return
            self._ask_for(steps)

    def _ask_for(self, steps: int) -> None:
        """Let compiled code take a number of steps."""
        if steps > len(self._states):
            self._states = np.zeros((steps, self._room + SUMS))
            self._write_context()
        self._steps = self._fields[_STEPS] = steps

    def _listen(self, data: mujoco.MjData, steps: int, parts: list[LazyEvents]) -> int:
        """Add the collisions of compiled code, and take the step that it has left; return the number of steps taken."""
        taken, how, total = self._fields[_TAKEN], self._fields[_STATUS], self._total
        if total[LAST] or total[SHORT]:
            self._scheme.collisions.unlocated += int(total[LAST])
            self._scheme.collisions.short_steps += int(total[SHORT])
        if total[COUNT]:
            parts.append(RepeatedStep(self._repeater, self._states[:taken].copy(), total))
        return taken if how == world.FINE else taken + self._go_on(how, data, steps - taken, parts)

    def _go_on(self, how: int, data: mujoco.MjData, steps: int, parts: list[Any]) -> int:
        """Take the step that compiled code has left, or look up a coefficient; return the number of steps taken."""
        if how == world.UNKNOWN:
            self._coefficients.learn(int(self._context[CONTEXT.asked]))
            self._write_context()
            return 0
        if how == world.DIVERGED:
            time = self._states[self._fields[_TAKEN], 0]  # MuJoCo resets the time of data
            raise DivergenceError(f"MuJoCo met a state that is not finite, or huge, in the step after t = {time:g} s")
        if how == world.CALLBACK:
            self._tell(_CALLED_BACK)
        else:
            steps = 1
        self._in_python(data, steps, parts)
        return steps

    def _in_python(self, data: mujoco.MjData, steps: int, parts: list[Any]) -> None:
        for _ in range(steps):
            events = self._scheme.step(data)
            if events:
                parts.append(events)

    def repeat(self, row: np.ndarray, data: mujoco.MjData) -> tuple[LazyEvents, list[Outcome]]:
        """Repeat a step from the state and sums in a row; return what `step` does, and what compiled code has found."""
        told, found, count, surfaces = (), np.zeros(0), _ROOM, self._scheme.collisions.surfaces
        while len(found) < count:
            found = np.zeros(count)
            mujoco.mj_resetData(self._model, data)  # results do not depend on steps that were repeated before
            restore_state(self._model, data, row[:-SUMS], STEP_STATE)
            if surfaces is not None:
                surfaces.forget()
            self._context[CONTEXT.outcomes], self._context[CONTEXT.outcome_count] = found.ctypes.data, count
            told = self.step(data)
            count = 1 + int(found[0])
        self._context[CONTEXT.outcome_count] = 0
        return told, outcomes_in(self._model, found[1:count])

    def __getstate__(self) -> dict[str, Any]:
        """Return the arguments of `__init__`: a copy begins anew with the same scheme."""
        return {"scheme": self._scheme, "warn": self._warn}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Begin anew with these arguments."""
        self.__init__(state["scheme"], warn=state["warn"])
