"""A law that replaces the method by which an existing environment steps MuJoCo."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import mujoco

from impactlaw.envs.episode_seeds import OUTCOMES, EpisodeSeeds
from impactlaw.envs.info import impact_info, steps_short
from impactlaw.envs.law_in_force import LawInForce
from impactlaw.envs.law_options import LawOptions
from impactlaw.envs.logs.episode_log import EpisodeLog
from impactlaw.envs.placing.contact_forces import ContactForces
from impactlaw.errors import DivergenceError, WrapperError
from impactlaw.settled import Settled
from impactlaw.stepping.impact_event import NOTHING, ImpactEvent, LazyEvents
from impactlaw.stepping.integration import is_huge
from impactlaw.stepping.stepper import Stepper

BY_STEPPER = '; call impactlaw.Stepper(model, law, contact_model="soft").step(data) in place of mujoco.mj_step there'
_ANEW = "put the law on anew, after remove()"
_OPTIONS = (
    "contact_model", "scheme", "friction", "rest_speed", "on_inadmissible", "contacts", "limits", "impulse_in_cfrc_ext",
)  # fmt: skip


class PlacedLaw(LawInForce, ABC):
    """A law that replaces the stepping of an environment until `remove` is called.

    Args:
        target: the object whose method is replaced.
        options: the law and its options.
        log: the log to record to, if any.

    Attributes:
        diverged: whether the simulation has diverged in the last environment step.
    """

    method: str
    """Name of the method that is replaced on the instance that steps."""

    contact_model, scheme, friction, contacts = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    rest_speed, on_inadmissible, limits = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    impulse_in_cfrc_ext, log, log_every = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)

    def __init__(self, target: Any, options: LawOptions, log: EpisodeLog | None):
        self._target = target
        for name in _OPTIONS:
            setattr(self, name, getattr(options, name))
        self.log, self.log_every = (None, 1) if log is None else (log.path, log.every)
        self._removed, self._stepped, self._log = False, False, log
        self._met: list[LazyEvents]
        self._options = self._in_force = options
        self.seeds = EpisodeSeeds(OUTCOMES)
        self._forces: ContactForces | None = None
        self.clear()
        self._install(self.simulation()[0])

    @property
    def events(self) -> tuple[ImpactEvent, ...]:
        """The collisions in all timesteps of the last environment step, in order."""
        return tuple(event for told in self._met for event in (told() if callable(told) else told))

    def info(self) -> dict[str, int | float | str]:
        """Return the entries of `impact_info` for the last environment step, and the law and restitution in force."""
        return impact_info(self._sums, short=self._short, diverged=self.diverged) | self._law_info()

    def clear(self) -> None:
        """Forget the last environment step."""
        self._met, self._sums, self._short = [], NOTHING, 0
        self.diverged = False
        if self._forces is not None:
            self._forces.clear()

    def prepare_reset(self, options: Mapping[str, Any] | None) -> None:
        """Put the options of a reset into force for the episode that it begins, and pause recording until then."""
        self.use(self._options.for_reset(options, self.seeds))
        if self._log is not None:
            self._log.pause()

    def begin_episode(self, scene: str | None, seed: int | None, generator: Any) -> None:
        """Follow a reset, which may have compiled a new model, and record the initial state of the episode."""
        self._stepped = False
        model, data = self.simulation()
        stepper = self._stepper_for(model)
        if self._log is not None:
            self._log.name_run(scene, seed, self.frame_skip)
            self._log.begin(stepper, data, self._in_force, seed=seed, generator=generator)

    def begin_step(self) -> None:
        """Forget the last environment step, before the next one begins."""
        self.clear()
        if self._log is not None:
            self._log.begin_step(*self.simulation())

    def record_step(self, action: Any, reward: Any, terminated: bool, truncated: bool) -> None:
        """Record the end of an environment step."""
        if self._log is not None:
            self._log.end_step(*self.simulation(), action, reward, terminated, truncated)

    def check_stepped(self, since: float) -> None:
        """Raise if an environment has advanced MuJoCo's time, though the law has not stepped in this episode.

        Once the law has stepped, time may pass without it: a reset within a step lets a robot settle or moves it.

        Args:
            since: time at the start of the environment step, s.

        Raises:
            WrapperError: the environment steps MuJoCo by another method.
        """
        if not self._stepped and self.simulation()[1].time > since:
            name = name_of(self._target)
            raise WrapperError(
                f"{name} steps MuJoCo in a way of its own, not by {self.method}: the law has no effect{BY_STEPPER}"
            )

    def close(self) -> None:
        """End the recording."""
        if self._log is not None:
            self._log.finish()
            self._log = None

    def remove(self) -> None:
        """Restore the original stepping of the environment, and end the recording."""
        self._removed = True
        self.close()
        target = self._target
        if vars(target).get(self.method) == self._simulate:
            delattr(target, self.method)

    def _set(self, **changes: Any) -> None:
        """Change the standing options and those in force, unless the law was removed."""
        if self._removed:
            raise WrapperError(
                f"the law was removed, so that {' and '.join(changes)} would change nothing; put it on anew"
            )
        super()._set(**changes)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy, which does not record."""
        return self.__dict__ | {"_log": None}

    @property
    def options(self) -> tuple[LawOptions, LawOptions]:
        """The standing options, and those in force in this episode."""
        return self._options, self._in_force

    @property
    def frame_skip(self) -> int | None:
        """Timesteps per environment step; None if unknown."""
        return None

    @abstractmethod
    def simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return the present model and data."""

    @abstractmethod
    def _simulate(self, *args: Any, **kwargs: Any) -> None:
        """Step MuJoCo; this replaces the method of the instance."""

    def _install(self, model: mujoco.MjModel) -> None:
        target = self._target
        present = vars(target).get(self.method)
        if present is not None:
            holder = getattr(present, "__self__", None)
            what = f"has the law {holder.law!r} already" if isinstance(holder, PlacedLaw) else "was replaced already"
            raise WrapperError(f"the stepping of {name_of(target)} {what}; take that off first, with remove()")
        self._make_stepper(model)
        setattr(target, self.method, self._simulate)

    def _stepper_for(self, model: mujoco.MjModel) -> Stepper:
        if self._stepper.model is not model:
            self._make_stepper(model)
        return self._stepper

    def _make_stepper(self, model: mujoco.MjModel) -> None:
        self._stepper = self._in_force.stepper(model)
        if self._options.impulse_in_cfrc_ext:
            self._forces = ContactForces(model, rigid=self._options.contact_model == "rigid")

    def _advance(self, model: mujoco.MjModel, data: mujoco.MjData, steps: int, *, half: bool = False) -> None:
        """Advance by a number of timesteps; with half, the first one starts at its second half."""
        stepper, self._stepped = self._stepper_for(model), True
        if self._log is not None:
            self._log.watch(stepper, data, self._in_force)
        while steps:
            some, short = 1 if half or self._watched else steps, steps_short(stepper)
            try:
                if half:
                    stepper.finish_step(data)
                else:
                    stepper.step(data, some)
            except DivergenceError:
                self._diverge()
                raise
            steps, half, self._short = steps - some, False, self._short + steps_short(stepper) - short
            told = stepper.told
            if told:
                self._met.append(told)
                self._sums = self._sums.with_more(stepper.sums) if self._sums.collisions else stepper.sums
            if self._forces is not None:
                self._forces.add(data, some, stepper.events if told else ())
            if self._log is not None:
                self._log.step(stepper, data, stepper.events)

    def _diverge(self) -> None:
        """Let the environment step count as diverged, and tell no collisions, also of the timesteps before."""
        self.clear()
        self.diverged = True

    @property
    def _watched(self) -> bool:
        """Whether every timestep must be taken by itself, to be recorded or summed."""
        return self._log is not None or (self._forces is not None and self._options.contact_model == "rigid")

    def _write_forces(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """After a step, compute ``cfrc_ext`` with the impulses of the law, if the option asks for it."""
        if self._forces is not None:
            mujoco.mj_rnePostConstraint(model, data)
            self._forces.write(data)

    def _advance_checked(self, model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> None:
        """Advance by a number of timesteps; raise DivergenceError if controls or state are not finite, or huge.

        MuJoCo would set all controls to 0 and continue. With RK4, it notices such a state only in the next timestep.
        """
        if not mujoco.mju_norm(data.ctrl) <= mujoco.mjMAXVAL:
            self._diverge()
            raise DivergenceError(f"the controls at t = {data.time:g} s are not finite, or huge")
        self._advance(model, data, steps)
        if is_huge(data):
            self._diverge()
            raise DivergenceError(f"the state at t = {data.time:g} s is not finite, or huge")


def name_of(target: Any) -> str:
    """Return the name of an object's class; for a proxy, that of the object behind it."""
    return target.__class__.__name__
