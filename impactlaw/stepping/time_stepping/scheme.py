"""Time stepping after Moreau and Jean: in every step one detection of contacts, and one problem for all of them.

With the timestep h, the integrator's mass matrix ``M_h`` and everything evaluated at the midpoint ``q_M``:

    q_M = q ⊕ (h / 2) v
    v_free = v + h M_h^-1 f(q_M, v)                          MuJoCo's integrator without contact
    0 <= Lambda  ⊥  J v+ - gamma^h >= 0,  v+ = v_free + M_h^-1 J^T Lambda      and friction in its cones
    q+ = q_M ⊕ ((h / 2) v+ + h w)                            w opens overlaps, separately from the velocities

(J. J. Moreau, *Numerical aspects of the sweeping process*, Comput. Methods Appl. Mech. Eng. 177, 1999; M. Jean, same
volume.) ``gamma^h`` is the law's target for colliding contacts (`targets`), and half the turn of the gradient for
persistent contacts (`gradient_turns`). The work of contact in a step is ``Lambda^T (gamma- + gamma+) / 2``, and
forces that do not depend on velocity do their work to second order. Therefore contact creates no energy, and an elastic
ball keeps its energy exactly.

A contact that is hit only through others, across a gap that is still open, collides after them in the same step,
starting from the velocity after their collision (`problem.phases`).

No step fails: if the law cannot be met, the step ends at the nearest point, and ``shortfall`` gives the deviation.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import DivergenceError, warn_of_python
from impactlaw.laws import Law
from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.solvers import load_solvers
from impactlaw.stepping.compatibility import refuse_override
from impactlaw.stepping.compiled.engine import when_gone
from impactlaw.stepping.compiled.fields import SIZE
from impactlaw.stepping.compiled.layout import empty_stack, structure_at
from impactlaw.stepping.compiled.one_world import OneWorld
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.integration import STEP_STATE, check_input, check_timestep, empty_state, restore_state
from impactlaw.stepping.time_stepping.calls import Calls, Posed
from impactlaw.stepping.time_stepping.compiled.entry import CONTEXT, single
from impactlaw.stepping.time_stepping.compiled.model_copy import changed_in_place, room
from impactlaw.stepping.time_stepping.compiled.state import memory, status
from impactlaw.stepping.time_stepping.compiled.state.hook import HOOK
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY
from impactlaw.stepping.time_stepping.compiled.state.surfaces import put_motion
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING
from impactlaw.stepping.time_stepping.events import events_of
from impactlaw.stepping.time_stepping.law_in_scene import LawInScene
from impactlaw.stepping.time_stepping.repeated_steps import RepeatedStep, StepRepeater

_COLLIDED, _SUMS, _STATUS = MEMORY.collided, SETTING.sums, CONTEXT.status
_NO_ACTUATION = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)


class TimeStepping(OneWorld):
    """The algorithm behind ``Stepper(contact_model="rigid", scheme="time-stepping")``; see there for the options.

    Steps are in compiled code. It asks laws in Python for which it has no table, and passes the user's model to MuJoCo
    while callbacks are set, since MuJoCo knows no other model to pass on to them.

    Args:
        law: the law in the scene.
        warn: whether to warn of a law that is asked in Python.
        sums: whether steps compute the sums over their collisions.

    Attributes:
        law: the law in the scene.
        numbers: the memory of the world, see `compiled.state.memory.Memory`.
        unlocated: always 0, since no collision is located.
    """

    def __init__(self, law: LawInScene, *, warn: bool = False, sums: bool = False):
        model: Any = law.model
        super().__init__(model, single.address, CONTEXT)
        self.law, self._warn, self._sums = law, warn, float(sums)
        self._memory = memory.make_memory(model, 1)
        when_gone(self, memory.free, self._memory)
        self._before, self.numbers = np.zeros(self._memory.shape[1]), self._memory[0]
        self._counts, self._told = self.numbers.view(np.int64), memoryview(self.numbers.data)
        self.unlocated = 0
        self._replay: weakref.ref[RepeatedStep] | None = None  # the last collision
        self._structure, self._state = np.zeros(int(self._table[SIZE.model]) // 8), empty_state(model, STEP_STATE)
        self._margins, self._settings = np.zeros(room(model)), np.zeros(len(SETTING))
        self._options = memoryview(self._settings.data)
        self._bilateral, self._scratch = constraint_kinds(model), mujoco.MjData(model)
        self._take_over()

    def _take_over(self) -> None:
        """Adopt the law and its options."""
        law = self.law
        self._coefficients, self._calls = law.coefficients(), Calls(law)
        sums = max(self._sums, self._settings[SETTING.sums])
        self._settings[:] = law.settings()
        self._settings[SETTING.sums] = sums
        self._inertial = law.inertial
        self._repeater = StepRepeater(law, partial(TimeStepping, sums=True), self._settings)
        self.keep_collisions(law.keeps)
        self._write_context()
        if law.asks:
            load_solvers()
        if self._warn and law.reason is not None:
            self._warn = False
            warn_of_python(law.reason, "a law is asked in Python at each collision")

    def keep_collisions(self, wanted: bool) -> None:
        """Have the following steps keep their collisions, instead of being taken again when events are read."""
        self._keeps, self._calls.hook[HOOK.keeps] = wanted, wanted
        self._context[CONTEXT.python] = self._calls.hook.ctypes.data if wanted else 0

    def watch(self, look: Callable[[Posed], object]) -> None:
        """Have the following steps under this law pass each contact problem to a function before they solve it."""
        self.keep_collisions(True)
        self._calls.watch, self._calls.hook[HOOK.watches] = look, 1

    def _write_context(self) -> None:
        """Write addresses and sizes of all arrays for compiled code."""
        arrays = {
            "settings": self._settings, "carriers": self.law.carriers, "bilateral": self._bilateral,
            "memory": self._memory, "structure": self._structure, "margins": self._margins, "state": self._state,
            "before": self._before,
        }  # fmt: skip
        numbers = {
            "scratch": structure_at(self._scratch), "memories": self._memory.shape[1],
            "margin_count": len(self._margins), "states": len(self._state),
        }  # fmt: skip
        self._fill_context(arrays, numbers)

    @property
    def shortfall(self) -> float:
        """Largest amount by which a normal contact velocity of the last step misses the law, m/s or rad/s."""
        return float(self.numbers[MEMORY.shortfall])

    @property
    def short_steps(self) -> int:
        """Number of short steps, see `Stepper.short_steps`.

        Further steps are counted for which MuJoCo had no room for all contacts, or in which contacts were left out that
        a collision closes.
        """
        return int(self.numbers[MEMORY.short_steps])

    @property
    def solved(self) -> bool:
        """Whether the last step with contact is not among the short ones, apart from friction that was not found."""
        return bool(self._counts[MEMORY.solved])

    def set_law(self, law: Law) -> None:
        """Use another law for the collisions of the next steps; those not read yet follow the old one."""
        self.law = self.law.under(law)
        self._take_over()

    def take_surfaces(self, surfaces: Surfaces) -> None:
        """Continue with these surfaces, moved by mocap bodies, if the scene has any."""
        put_motion(self.numbers, self._model, surfaces.last_motion)

    def step(self, data: mujoco.MjData) -> Callable[[], tuple[ImpactEvent, ...]] | tuple[()]:
        """Advance by one timestep; return a function for its collisions, or (). After an error, data is as before."""
        if self._replay is not None and (replay := self._replay()) is not None:
            _ = replay.start  # copies what the step overwrites
        if not self._inertial.act and self._inertial.look():
            self._settings[SETTING.inertial] = 1.0
        world: Any = data
        entry, kept, fields, error = self._entry or self._open(), self._keeps, self._fields, None
        if kept:
            self._calls.begin(data)
        try:
            fields[_STATUS] = status.UNDER_WAY
            while (how := entry.call(world._address)) != status.FINE:
                if how == status.CALLBACK:
                    kept, how = True, self._with_callbacks(data)
                if how == status.UNKNOWN:
                    self._coefficients.learn(fields[CONTEXT.asked])
                    self._write_context()
                elif how != status.FINE:
                    raise self._error(how, data)
                else:
                    break
                fields[_STATUS] = status.UNDER_WAY
        except BaseException as raised:
            try:
                error = self._undone(raised, data)
            except (KeyboardInterrupt, SystemExit) as second:  # undone in part; `timeout` sends two signals
                error = self._undone(second, data)
        if error is not None:
            try:
                raise error
            finally:
                del error  # which refers to this frame
        if not self._told[_COLLIDED]:
            return ()
        if kept:
            return partial(events_of, tuple(self._calls.collisions))
        summed = self._options[_SUMS]
        replay = RepeatedStep(self._repeater, self, self._state, self._before, self.numbers, summed)
        self._replay = weakref.ref(replay)
        return replay

    def _with_callbacks(self, data: Any) -> int:
        """Take a step through the user's model, and keep its collisions, since callbacks may not repeat what they do.

        Return how it has ended. An error of a callback is one of MuJoCo, which is raised as that of the callback. What
        is restored at the end is restored without calls of Python code, in which an interrupt may arise.
        """
        calls, fields, entry, settings = self._calls, self._fields, self._entry or self._open(), self._settings
        hook, python = calls.hook, calls.hook.ctypes.data
        calls.begin(data)
        given, asks = (fields[CONTEXT.structure], fields[CONTEXT.python]), settings[SETTING.asks]
        controls = mujoco.get_mjcb_control() is not None and not self._model.opt.disableflags & _NO_ACTUATION
        lacks = np.isnan(settings[[SETTING.restitution, SETTING.reversal]]).all()
        restore_model = changed_in_place(self._model)
        try:
            fields[CONTEXT.structure], fields[CONTEXT.python] = self._model._address, python
            hook[HOOK.controls], hook[HOOK.keeps] = controls, 1
            settings[SETTING.asks] = asks or float(lacks)  # a table that lacks a contact would call callbacks again
            fields[_STATUS] = status.UNDER_WAY
            how = entry.call(data._address)
        finally:
            fields[CONTEXT.structure], fields[CONTEXT.python] = given
            hook[HOOK.controls], hook[HOOK.keeps] = 0, self._keeps
            settings[SETTING.asks] = asks
            restore_model()
        if how > 0:
            mujoco.mj_fwdPosition(self._model, data)  # contacts are those of the user's margins again
        return how

    def _undone(self, raised: BaseException, data: mujoco.MjData) -> BaseException:
        """Undo what a step has done before an error, unless it is finished; return the error as it was raised."""
        how = self._fields[_STATUS]
        if how == status.UNKNOWN:
            self._write_context()  # the table may have new addresses
        if how not in (status.UNDER_WAY, status.RAISED):
            return raised
        if how == status.UNDER_WAY:
            empty_stack(data)
            restore_state(self._model, data, self._state, STEP_STATE)
            memory.restore(self.numbers, self._before.copy(), memory.raw(self._before))
        if not isinstance(raised, mujoco.FatalError):
            mujoco.mj_fwdPosition(self._model, data)
        cause = raised.__cause__ if isinstance(raised, SystemError) else None  # Python's way to tell of an error in C
        return raised if cause is None else cause

    def _error(self, how: int, data: mujoco.MjData) -> BaseException:
        """Return the error of a step that has ended like this."""
        if how < 0:
            self._fail(data, self._state, (self._entry or self._open()).message)
        if how == status.TIMESTEP:
            check_timestep(self._model.opt.timestep)
        if how == status.OVERRIDDEN:
            refuse_override(self._model)
        if how == status.HUGE_INPUT:
            check_input(self._model, data, self._state)
        if how == status.CREATES:
            return self.law.inadmissible(float(self.numbers[MEMORY.created]), data.time)
        if how == status.NOT_FINITE:
            return DivergenceError(f"the forces at t = {data.time:.6g} s are not finite")
        return DivergenceError(f"position or velocity is not finite, or huge, at t = {data.time:.6g} s")

    def __getstate__(self) -> dict[str, Any]:
        """Return the memory, too, so that a copy continues from it."""
        given = {"law": self.law, "warn": self._warn, "sums": bool(self._sums)}
        return given | {"numbers": self.numbers.copy(), "known": memory.raw(self.numbers)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Continue from the memory of the original."""
        self.__init__(state["law"], warn=state["warn"], sums=state["sums"])
        memory.restore(self.numbers, state["numbers"], state["known"])
