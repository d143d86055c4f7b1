"""Put a law in place of dm_control's `Physics.step`."""

from __future__ import annotations

import contextlib
import copy
from typing import Any

import mujoco
from dm_control.mujoco.engine import Physics
from dm_control.rl.control import PhysicsError

from impactlaw.envs.episode_seeds import OUTCOMES, NoSeeds
from impactlaw.envs.law_options import LawOptions
from impactlaw.envs.logs.episode_log import EpisodeLog
from impactlaw.envs.placing.placed_law import PlacedLaw
from impactlaw.errors import DivergenceError, WrapperError
from impactlaw.stepping.stepper import Stepper
from impactlaw.stepping.time_stepping.problem.forces import forward_keeping_contacts

_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_BAD = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{name}")) for name in ("QPOS", "QVEL", "QACC", "CTRL")]


class OnPhysics(PlacedLaw):
    """A law on a dm_control `Physics`; copies and pickles of the physics have the law too, but do not record."""

    method = "step"
    _composer = False

    def remove(self) -> None:
        """Restore the original stepping of the physics, and end the recording."""
        with contextlib.suppress(ReferenceError):  # a closed composer environment has no physics
            super().remove()
            for name in _COPYING:
                vars(self._target).pop(name, None)

    def _install(self, model: mujoco.MjModel) -> None:
        super()._install(model)
        self._target.copy = self._copy
        self._target.__reduce_ex__ = self._reduce

    def _copy(self, share_model: bool = False) -> Any:
        """Replace `Physics.copy`: return a copy with the law."""
        physics = self._target
        stepper = self._stepper_for(physics.model.ptr)
        return _with_law(physics.__class__.copy(physics, share_model=share_model), *self.options, stepper)

    def go_on(self, stepper: Stepper) -> None:
        """Continue as the stepper of a physics of which this one is a copy."""
        self._stepper = copy.deepcopy(stepper, {id(stepper.model): self.simulation()[0]})

    def _reduce(self, _protocol: int) -> tuple[Any, ...]:
        """Replace `Physics.__reduce_ex__`: `copy` and `pickle` make copies with the law."""
        physics = self._target
        return _remade, (physics.__class__, physics.data, *self.options, self._stepper_for(physics.model.ptr))

    def simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return the present model and data."""
        return self._target.model.ptr, self._target.data.ptr

    def _simulate(self, nstep: int = 1) -> None:
        if not self._composer:  # a suite environment steps its physics once per environment step
            self.clear()
        physics = self._target
        try:  # check_invalid_state raises PhysicsError, or warns if the task suppresses it
            with physics.check_invalid_state(), contextlib.suppress(DivergenceError):
                self._step(nstep)
        except PhysicsError:
            self.diverged |= bool(physics.data.ptr.warning.number[_BAD].any())
            raise

    def _step(self, nstep: int) -> None:
        """Step as `Physics.step` does: with ``legacy_step``, start and end between the halves of a MuJoCo step.

        The order is `mj_step2`, whole steps, `mj_step1`; RK4 and rigid contact have no half steps and skip `mj_step2`.
        Contacts that tasks read after rigid steps remain those of the steps.
        """
        (model, data), legacy = self.simulation(), self._target.legacy_step
        half = legacy and self._options.contact_model == "soft" and model.opt.integrator != _RK4
        self._advance(model, data, nstep, half=half)
        self._write_forces(model, data)
        if legacy and self._options.contact_model == "rigid":
            forward_keeping_contacts(model, data)
        elif legacy:
            mujoco.mj_step1(model, data)


class OnDmControl(OnPhysics):
    """A law on a dm_control environment, suite or composer, with or without wrappers around it.

    A composer environment makes a new physics at every reset, and the law is put into each of them. A state that is not
    finite raises dm_control's own `PhysicsError`, as without the law. A copy of a suite environment has the law too;
    dm_control cannot copy composer environments.

    Raises:
        WrapperError: the environment does not step MuJoCo by dm_control's `Physics.step`, or has a law already.
    """

    def __init__(self, env: Any, options: LawOptions, log: EpisodeLog | None):
        physics = getattr(env, "physics", None)
        if not isinstance(physics, Physics):
            raise WrapperError(f"{type(env).__name__} does not step MuJoCo: it has no dm_control Physics")
        if physics.__class__.step is not Physics.step:
            raise WrapperError(f"{physics.__class__.__name__} steps MuJoCo in a way of its own (step is overridden)")
        super().__init__(physics, options, log)
        self._env: Any = env
        self._told: Any = None
        self._composer = hasattr(env, "add_extra_hook")
        if self._composer:
            self._env.add_extra_hook("after_compile", self._after_compile)
            self._env.add_extra_hook("before_step", self._before_step)

    @property
    def frame_skip(self) -> int | None:
        """Timesteps per environment step."""
        return round(self._env.control_timestep() / self._target.timestep())

    def record_steps(self, env: Any) -> None:
        """Also record actions and rewards of an environment's steps, if there is a log; a physics has neither."""
        if self._log is not None:
            self._told, self._plain_step = env, env.step
            env.step = self._told_step

    def _told_step(self, action: Any) -> Any:
        """Replace the environment's `step`: record each step that was not a reset."""
        result = self._plain_step(action)
        if not result.first():
            ended = result.last()
            self.record_step(action, result.reward, ended and result.discount == 0.0, ended and result.discount != 0.0)
        return result

    def remove(self) -> None:
        """Restore the original stepping of the environment, and end the recording."""
        super().remove()
        if self._told is not None and vars(self._told).get("step") == self._told_step:
            del self._told.step

    def _after_compile(self, physics: Any, _random_state: Any) -> None:
        if not self._removed:
            self._target = physics
            self._install(physics.model.ptr)

    def _before_step(self, *_: Any) -> None:
        if not self._removed:
            self.clear()


def law_on(physics: Any) -> OnPhysics | None:
    """Return the law that steps a dm_control `Physics`; None if there is none."""
    holder = getattr(vars(physics).get(OnPhysics.method), "__self__", None)
    return holder if isinstance(holder, OnPhysics) else None


_COPYING = ("copy", "__reduce_ex__")
"""Methods replaced on an instance besides `step`, so that copies have the law."""


def _remade(kind: type[Physics], data: Any, *law: Any) -> Any:
    physics = kind.__new__(kind)
    physics.__setstate__(data)
    return _with_law(physics, *law)


def _with_law(physics: Any, standing: LawOptions, in_force: LawOptions, stepper: Stepper) -> Any:
    """Put the law into a copy of a physics; it continues from what the stepper of that remembers of its last step."""
    law = OnPhysics(physics, standing, None)
    law.seeds = NoSeeds(OUTCOMES)
    law.use(in_force)
    law.go_on(stepper)
    return physics
