"""A law in the place where somebody else's environment steps MuJoCo."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import mujoco

from impactlaw.envs.base import choose_law
from impactlaw.envs.info import ImpactTally
from impactlaw.errors import DivergenceError, WrapperError
from impactlaw.events import ImpactEvent
from impactlaw.flow import is_huge
from impactlaw.laws import Law
from impactlaw.recording import Recorder
from impactlaw.stepper import Stepper


@dataclass(frozen=True)
class LawOptions:
    """What `ImpactLaw` and `put_law` take; see there."""

    law: str | Law
    restitution: Any
    contact_model: Literal["rigid", "soft"]
    scheme: Literal["event-driven", "time-stepping"] | None
    rest_speed: float | None
    on_inadmissible: Literal["raise", "project", "allow"]

    def stepper(self, model: mujoco.MjModel) -> Stepper:
        """Return a stepper for the model."""
        rigid = self.contact_model == "rigid"
        return Stepper(
            model,
            choose_law(model, self.law, self.restitution),
            contact_model=self.contact_model,
            scheme=(self.scheme or "time-stepping") if rigid else self.scheme,
            overlap="push-out" if rigid else None,  # a reset is not the user's to change
            rest_speed=self.rest_speed,
            on_inadmissible=self.on_inadmissible,
        )


class RunLog:
    """A recording that follows an environment from model to model: ``run.rrd``, then ``run-2.rrd`` and so on.

    Args:
        path: the first file.
        scene: name of the environment.
    """

    def __init__(self, path: str | Path, scene: str | None):
        self._path = Path(path)
        self._scene = scene
        self._seed: int | None = None
        self._files = 0
        self._empty = True
        self._recorder: Recorder | None = None

    def open(self, model: mujoco.MjModel, law: Law, seed: int | None = None) -> None:
        """Begin a file for the model; one in which nothing was recorded yet is begun again."""
        self.close()
        self._seed = self._seed if seed is None else seed
        self._files += not (self._files and self._empty)
        name = self._path.name if self._files == 1 else f"{self._path.stem}-{self._files}{self._path.suffix}"
        self._recorder = Recorder(model, self._path.with_name(name), law=law, scene=self._scene, seed=self._seed)
        self._empty = True

    @property
    def is_empty(self) -> bool:
        """Whether nothing was recorded in the file of now."""
        return self._empty

    def step(self, data: mujoco.MjData, events: tuple[ImpactEvent, ...]) -> None:
        """Record a timestep."""
        if self._recorder is not None:
            self._recorder.step(data, events)
            self._empty = False

    def close(self) -> None:
        """End the file."""
        if self._recorder is not None:
            self._recorder.close()
            self._recorder = None


class PlacedLaw(ABC):
    """A law that an environment's stepping has been given; `remove` takes it away again.

    Attributes:
        diverged: whether the simulation has left the finite numbers in the environment step.
    """

    method: str
    """What is replaced on the instance that steps."""

    def __init__(self, options: LawOptions, log: RunLog | None):
        self.diverged = False
        self._options = options
        self._log = log
        self._events: list[ImpactEvent] = []
        self._stepper: Stepper | None = None

    @property
    def law(self) -> Law:
        """The law of the present model."""
        assert self._stepper is not None
        return self._stepper.law

    @property
    def events(self) -> tuple[ImpactEvent, ...]:
        """The collisions of the last environment step, all its timesteps, in order."""
        return tuple(self._events)

    def info(self) -> dict[str, int | float]:
        """Return what `ImpactTally` says of the last environment step."""
        tally = ImpactTally()
        tally.add(self._events)
        return tally.info(diverged=self.diverged)

    def clear(self) -> None:
        """Forget the last environment step."""
        self._events = []
        self.diverged = False

    def record_seed(self, seed: int | None) -> None:
        """Note the seed in the recording, if it has not begun."""
        if self._log is not None and self._stepper is not None and seed is not None and self._log.is_empty:
            self._log.open(self._stepper.model, self._stepper.law, seed)

    def close(self) -> None:
        """End the recording."""
        if self._log is not None:
            self._log.close()
            self._log = None

    def remove(self) -> None:
        """Let the environment step as it did before, and end the recording."""
        self.close()
        target = self._target()
        if vars(target).get(self.method) == self._simulate:
            delattr(target, self.method)

    def __getstate__(self) -> dict[str, Any]:
        """A copy does not record."""
        return self.__dict__ | {"_log": None}

    @abstractmethod
    def _target(self) -> Any:
        """Return the instance whose method is replaced."""

    @abstractmethod
    def _simulate(self, *args: Any, **kwargs: Any) -> None:
        """Step MuJoCo in the place of the method."""

    def _install(self, model: mujoco.MjModel) -> None:
        target = self._target()
        present = vars(target).get(self.method)
        if present is not None:
            holder = getattr(present, "__self__", None)
            what = f"has the law {holder.law!r} already" if isinstance(holder, PlacedLaw) else "was replaced already"
            raise WrapperError(f"the stepping of {name_of(target)} {what}; take that off first, with remove()")
        self._stepper_for(model)
        setattr(target, self.method, self._simulate)

    def _stepper_for(self, model: mujoco.MjModel) -> Stepper:
        if self._stepper is None or self._stepper.model is not model:
            self._stepper = self._options.stepper(model)
            if self._log is not None:
                self._log.open(model, self._stepper.law)
        return self._stepper

    def _advance(self, model: mujoco.MjModel, data: mujoco.MjData, steps: int, *, half: bool = False) -> None:
        """Advance by so many timesteps; the first one by its second half only."""
        stepper = self._stepper_for(model)
        for i in range(steps):
            try:
                (stepper.finish_step if half and i == 0 else stepper.step)(data)
            except DivergenceError:
                self.diverged = True
                raise
            if stepper.events:
                self._events += stepper.events
            if self._log is not None:
                self._log.step(data, stepper.events)

    def _refuse_bad_state(self, data: mujoco.MjData) -> None:
        """Under RK4 a state that is not finite, or huge, shows in the next timestep only."""
        if is_huge(data):
            self.diverged = True
            raise DivergenceError(f"the state at t = {data.time:g} s is not finite, or huge")


def name_of(target: Any) -> str:
    """Return the name of its class, of what a proxy stands for."""
    return target.__class__.__name__
