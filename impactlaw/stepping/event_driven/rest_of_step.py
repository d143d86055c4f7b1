"""What event-driven stepping leaves undone of a step is done by time stepping, under the same law and friction."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import mujoco

from impactlaw.laws import Law
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.solvers.one_thread import one_thread
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.plan import make_plan

if TYPE_CHECKING:
    from impactlaw.stepping.time_stepping.scheme import TimeStepping

_LONGEST_WAIT = 128
_PATIENCE = 4  # as many steps are waited as this goes into the wait, which doubles


class RestOfStep:
    """Takes what remains of steps; after several that were not finished, all of the next, twice as many every time.

    Args:
        model: the scene.
        law: as the user has given it.
        friction: see `Stepper`.
        on_inadmissible: see `Stepper`; as nothing is to raise here, "raise" becomes "project".
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
        self._wait = self._left = 0

    @property
    def short_steps(self) -> int:
        """Those that have not met the law so far."""
        return 0 if self._stepping is None else self._stepping.short_steps

    def set_law(self, law: Law) -> None:
        """Let what follows be under another law."""
        self._law = law
        if self._stepping is not None:
            self._stepping.set_law(law)

    def waits(self) -> bool:
        """Return whether the next step is to be time stepped from its start; to be asked once a step."""
        self._left -= 1
        return self._left >= 0

    def failed(self) -> None:
        """Note that a step was not finished."""
        self._wait = min(max(1, 2 * self._wait), _LONGEST_WAIT)
        self._left = self._wait // _PATIENCE

    def succeeded(self) -> None:
        """Note that a step needed nothing of this."""
        self._wait //= 2

    def take(
        self, data: mujoco.MjData, remaining: float, surfaces: Surfaces | None
    ) -> Callable[[], tuple[ImpactEvent, ...]] | tuple[()]:
        """Advance by what remains of a step, s; return what tells the collisions.

        Args:
            data: the state.
            remaining: duration, s.
            surfaces: that move by themselves, as they are now.

        Raises:
            DivergenceError: position or velocity is not finite.
        """
        stepping, option = self._made(), self._model.opt
        if surfaces is not None:
            surfaces.place(data)
            stepping.take_surfaces(surfaces.from_here(data))
            surfaces.aim(data)
        timestep = option.timestep
        option.timestep = remaining
        try:
            with one_thread():
                return stepping.step(data)
        finally:
            option.timestep = timestep

    def _made(self) -> TimeStepping:
        """Return the stepper; what it compiles once on every machine is loaded when it is first needed."""
        if self._stepping is None:
            from impactlaw.stepping.time_stepping.make import warm_up
            from impactlaw.stepping.time_stepping.scheme import TimeStepping

            warm_up()
            self._stepping = TimeStepping(
                self._model,
                self._law,
                make_plan(self._model, scheme="time-stepping", friction=self._friction),
                friction=self._friction,
                on_inadmissible=self._on_inadmissible,
                rest_speed=None,
            )
        return self._stepping
