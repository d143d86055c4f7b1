"""Finish steps that event-driven stepping cannot, by time stepping under the same law and friction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import mujoco

from impactlaw.laws import Law
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.solvers.one_thread import one_thread
from impactlaw.stepping.event_driven.last_step import LastStep
from impactlaw.stepping.event_driven.location.passing import Passing
from impactlaw.stepping.impact_event import LazyEvents, together
from impactlaw.stepping.plan import make_plan

if TYPE_CHECKING:
    from impactlaw.stepping.time_stepping.scheme import TimeStepping

_LONGEST_WAIT = 128
_PATIENCE = 4  # the number of steps to wait is the wait divided by this; the wait doubles
_PARTS = 64  # largest number of parts into which the rest of a step is cut


class RestOfStep:
    """Takes the rest of steps by time stepping; after repeated failures also whole steps, twice as many each time.

    Time stepping must not raise here: where `Stepper` would raise for inadmissible outcomes, they are projected.

    Time stepping looks for contacts in the middle of a step, and knows no half step before its first one. If a body
    would by then be behind another or deep in it, the rest is cut into equal parts. If a step starts where the last
    part ended and is no longer than that part, it is not cut: it continues from the middle of that part.

    Attributes:
        short_steps: number of steps so far that have not met the law.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        law: Law,
        *,
        friction: Literal["coulomb", "convex", "ignore"],
        on_inadmissible: Literal["raise", "project", "allow"],
    ):
        self._model, self._law = model, law
        self._friction: Literal["coulomb", "convex", "ignore"] = friction
        self._on_inadmissible: Literal["project", "allow"] = "allow" if on_inadmissible == "allow" else "project"
        self._stepping: TimeStepping | None = None
        self._passing: Passing | None = None
        self._wait = self._left = 0
        self._ended: tuple[bytes, bytes] = b"", b""
        self._part = 0.0  # duration of the last part, s
        self.short_steps = 0

    def set_law(self, law: Law) -> None:
        """Use another law from now on."""
        self._law = law
        if self._stepping is not None:
            self._stepping.set_law(law)

    def waits(self, last: LastStep) -> bool:
        """Return whether the next step is to be time stepped from its start; to be called once per step.

        Where the step does not begin at the end of the last one, as after a reset, earlier failures do not count.
        """
        if self._wait and not last.is_here():
            self._wait = self._left = 0
        self._left -= 1
        return self._left >= 0

    def failed(self) -> None:
        """Note that event-driven stepping could not finish a step."""
        self._wait = min(max(1, 2 * self._wait), _LONGEST_WAIT)
        self._left = self._wait // _PATIENCE

    def succeeded(self) -> None:
        """Note that event-driven stepping finished a step."""
        self._wait //= 2

    def take(self, data: mujoco.MjData, remaining: float, surfaces: Surfaces | None) -> LazyEvents:
        """Advance by the rest of a step, s; return the collisions, or a function that returns them."""
        stepping, passing = self._made()
        option, before = self._model.opt, stepping.short_steps
        if surfaces is not None:
            surfaces.place(data)
            stepping.take_surfaces(surfaces.from_here(data))
        parts = 1
        if self._part < remaining or (data.qpos.tobytes(), data.qvel.tobytes()) != self._ended:
            drift = 0.0 if surfaces is None else surfaces.speed
            parts = min(_PARTS, passing.parts(data, remaining, drift=drift))
        timestep = option.timestep
        option.timestep = self._part = remaining / parts
        try:
            with one_thread():
                told = [_advance(stepping, data, surfaces) for _ in range(parts)]
        finally:
            option.timestep = timestep
        self._ended = data.qpos.tobytes(), data.qvel.tobytes()
        self.short_steps += stepping.short_steps > before
        return together([part for part in told if part])

    def _made(self) -> tuple[TimeStepping, Passing]:
        """Return the stepping and the check of how far it may go, made on first use since they load compiled code."""
        if self._stepping is None or self._passing is None:
            from impactlaw.stepping.time_stepping.make import make_time_stepping

            plan = make_plan(self._model, scheme="time-stepping", friction=self._friction)
            self._passing = Passing(self._model, plan.pairs.geoms)
            self._stepping = make_time_stepping(
                self._model,
                self._law,
                plan,
                friction=self._friction,
                on_inadmissible=self._on_inadmissible,
                rest_speed=None,
                touching=0.0,  # persistent contact of event-driven steps is closer
                compiled="never",  # collisions are kept, since the timestep changes
            )
        return self._stepping, self._passing


def _advance(stepping: TimeStepping, data: mujoco.MjData, surfaces: Surfaces | None) -> LazyEvents:
    """Advance by the model's timestep; surfaces move to where they are at its end."""
    if surfaces is not None:
        now = data.time
        data.time = now + stepping.law.model.opt.timestep
        surfaces.place(data)
        data.time = now
    return stepping.step(data)
