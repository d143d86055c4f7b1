"""Put an impact law into existing environments: gymnasium's MuJoCo ones, gymnasium-robotics' and dm_control's."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from impactlaw.envs.law_options import RESET, LawOptions, check_reset, portable_options, warn_of_slips
from impactlaw.envs.logs.episode_log import episode_log
from impactlaw.envs.placing.gymnasium_steps import ignores_options, place
from impactlaw.envs.placing.placed_law import PlacedLaw
from impactlaw.envs.rendering import free_contexts, make_current
from impactlaw.errors import WrapperError
from impactlaw.laws import Law
from impactlaw.settled import Settled
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.stepper import Stepper

_ANEW = "put another ImpactLaw around the environment, after remove()"
_RESET = "pass it to reset(options=...), for an episode, or put another ImpactLaw around the environment"


class ImpactLaw(gymnasium.Wrapper, RecordConstructorArgs):
    """A wrapper that puts an impact law into an environment that steps MuJoCo, in one line and without a fork of it.

    ``ImpactLaw(gymnasium.make("Hopper-v5"), law="moreau", restitution=0.5)``. It covers gymnasium's MuJoCo environments
    (v4, v5 and subclasses of `MujocoEnv`), the robots of gymnasium-robotics, and dm_control's suite and composer tasks
    through shimmy (for bare ones use `put_law`). Observations, rewards and spaces remain those of the environment.
    Steps without a collision remain bit for bit what they were, unless contacts are tuned to bounce by themselves, or
    bodies touch while joints are damped by more than their inertia in a timestep. The law also applies to timesteps
    simulated by a reset, if the environment simulates them in the same way as its steps.

    ``info`` holds the entries of `impact_info`, summed over the timesteps of an environment step and zero at a reset,
    and names the law and the restitution in force; `events` holds the collisions themselves. The wrapper may be
    anywhere in a stack of wrappers, survives copies, pickling and ``gymnasium.make(env.spec)``, and follows an
    environment that compiles a new model.

    ``reset(options=...)`` takes "law", "restitution", "friction" and "scheme" for one episode; the next reset without
    them returns to those of the wrapper. Other options are passed on to the environment. A law or restitution assigned
    to the wrapper (``env.law = ...``, ``vec.set_attr("law", ...)``) takes effect with the next step and is permanent.
    All other arguments are fixed at construction, and assigning to them is an error.

    ``cfrc_ext``, which Ant and Humanoid observe and pay a contact cost for, holds the forces of MuJoCo's contacts in
    the last timestep of a step. The impulses of the law act instantaneously and are not part of it (they are in
    `events`). A hard landing therefore costs less than without the law, unless ``impulse_in_cfrc_ext`` adds them.

    If the simulation diverges, MuJoCo would silently continue from its initial state. Here the episode is truncated,
    not terminated, since no state of the task was reached: the observation is the last one before, the reward is 0, and
    ``info["impact/diverged"]`` is 1. The same happens after an action that is not finite, where MuJoCo would silently
    continue with zero controls.

    Pictures are drawn and freed in the environment's own OpenGL context, whichever context was current. Unwrapped
    gymnasium environments do neither: when one of them closes, the pictures of others can turn black.

    Args:
        env: the environment, wrapped or not.
        law: name of a law (`impactlaw.make_law`), "scene" for the restitution that the MJCF itself carries, or a `Law`.
        restitution: argument of the law.
        contact_model: "soft" keeps MuJoCo's contacts and friction between collisions. With "rigid", the law governs all
            contact, with exact Coulomb friction, and overlaps after a reset are pushed open.
        scheme: scheme of rigid contact: "time-stepping", the default, or "event-driven"; see `Stepper`.
        friction: "coulomb", the default, "convex" or "ignore"; see `Stepper`.
        rest_speed: closing speed, m/s, above which a contact collides; see `Stepper`.
        on_inadmissible: what to do with an outcome of the law outside S(v-): "raise", "project" it onto S(v-), or
            "allow" it; ``info["impact/inadmissible"]`` counts such outcomes.
        contacts: contacts between geoms to which the law applies: a pattern such as "*foot*" or "*foot*/floor", or
            several patterns; all contacts if not given. The others remain MuJoCo's, or have E = 0 if contact is rigid;
            see `Stepper`.
        limits: whether the law also applies to limits of joints and tendons; if not, they are treated like contacts
            that no pattern matches.
        impulse_in_cfrc_ext: whether to add the impulses of the law to ``cfrc_ext``, as their mean force over all
            timesteps of the environment step, on top of MuJoCo's forces in the last timestep. With rigid time stepping,
            ``cfrc_ext`` is then the mean of all contact forces over the timesteps.
        log: file in which to record every timestep, from the first reset until `close`, such as ``run.rrd``, or
            ``run-{env}-{episode}.rrd``; see `EpisodeLog`. A copy of the wrapper does not record.
        log_every: record every log_every-th episode, starting with the first.

    Raises:
        WrapperError: the environment does not step MuJoCo in a known way, or has a law already.
        UnknownNameError: there is no such law or option, or the law is keyed by contacts that the scene cannot have.
        RestitutionError: the restitution does not fit the law.
        SceneError: the scene has a flex or delays and contact_model is "rigid"; or an option has no meaning there.
        OptionError: rest_speed is not a speed, log_every is not a positive integer, or log has unknown fields.
        RecordingError: the recording exists already.
    """

    contact_model, scheme, friction = Settled(_ANEW), Settled(_RESET), Settled(_RESET)
    contacts, limits, impulse_in_cfrc_ext = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    rest_speed, on_inadmissible, log, log_every = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)

    def __init__(
        self,
        env: gymnasium.Env,
        law: str | Law | Mapping[str, Any],
        restitution: Any = None,
        *,
        contact_model: Literal["rigid", "soft"] = "soft",
        scheme: Literal["event-driven", "time-stepping"] | None = None,
        friction: Literal["coulomb", "convex", "ignore"] | None = None,
        rest_speed: float | None = None,
        on_inadmissible: Literal["raise", "project", "allow"] = "project",
        contacts: str | Sequence[str] | None = None,
        limits: bool = True,
        impulse_in_cfrc_ext: bool = False,
        log: str | Path | None = None,
        log_every: int = 1,
    ):
        settled = {
            "contact_model": contact_model, "scheme": scheme, "friction": friction, "rest_speed": rest_speed,
            "on_inadmissible": on_inadmissible, "contacts": contacts, "limits": limits,
            "impulse_in_cfrc_ext": impulse_in_cfrc_ext,
        }  # fmt: skip
        logged = {"log": log, "log_every": log_every}
        given = {"law": law, "restitution": restitution, **settled, **logged}
        RecordConstructorArgs.__init__(self, **portable_options(given))
        if isinstance(env, str):
            raise WrapperError(f"ImpactLaw is for a gymnasium.Env, got {env!r}; make it with gymnasium.make({env!r})")
        if not isinstance(env, gymnasium.Env):
            raise WrapperError(
                f"ImpactLaw is for a gymnasium.Env, got a {type(env).__module__}.{type(env).__name__}; a bare "
                "environment of dm_control gets its law by impactlaw.envs.put_law, one of several agents by an "
                "ImpactLaw around the environment inside (env.single_agent_env = ImpactLaw(env.single_agent_env, ...)) "
                "and of several environments each has an ImpactLaw of its own"
            )
        super().__init__(env)
        for name, value in (settled | logged).items():
            setattr(self, name, value)
        options = LawOptions(law=law, restitution=restitution, **settled)
        self._placed: PlacedLaw | None = place(env, options, episode_log(log, log_every))
        self._observation: Any = None
        self._reward: Any = 0.0

    @property
    def law(self) -> Law | None:
        """The law in force, or None after `remove`; a law assigned to it is in force from the next step on.

        Assigning raises the errors of the constructor, and then the law does not change; or WrapperError, if the law
        was removed.
        """
        return None if self._placed is None else self._placed.law

    @law.setter
    def law(self, law: str | Law | Mapping[str, Any]) -> None:
        self.placed.law = law

    @property
    def restitution(self) -> Any:
        """The restitution as given, None for the scene's own; assigning to it changes that of a law given by name."""
        return None if self._placed is None else self._placed.restitution

    @restitution.setter
    def restitution(self, restitution: Any) -> None:
        self.placed.restitution = restitution

    @property
    def events(self) -> tuple[ImpactEvent, ...]:
        """The collisions in all timesteps of the last step, in order."""
        return () if self._placed is None else self._placed.events

    @property
    def stepper(self) -> Stepper | None:
        """The stepper of this episode, with its plan and options; None after `remove`."""
        return None if self._placed is None else self._placed.stepper

    @property
    def placed(self) -> PlacedLaw:
        """The handle on the law in the environment, as `put_law` returns it.

        Raises:
            WrapperError: the law was removed.
        """
        if self._placed is None:
            raise WrapperError("the law was removed from this wrapper; put another ImpactLaw around the environment")
        return self._placed

    def remove(self) -> gymnasium.Env:
        """Remove the law and return the wrapped environment, which steps as it did before."""
        if self._placed is not None:
            self._placed.remove()
            self._placed = None
        return self.env

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: seed of the environment.
            options: "law", "restitution", "friction" and "scheme" for this episode only, each as in the constructor;
                other options are passed on to the environment.

        Raises:
            UnknownNameError: neither the wrapper nor the environment has such an option.
            OptionError: the options are not a mapping, or the seed is not a nonnegative integer.
            RestitutionError: the restitution does not fit the law.
            SceneError: an option has no meaning for the contact model.
            WrapperError: the law was removed, and the options ask for one.
        """
        if self._placed is None and not any(name in RESET for name in options or ()):
            return self.env.reset(seed=seed, options=options)
        placed = self.placed
        if ignores_options(self.env) or not isinstance(options, Mapping | None):
            check_reset(options)
        warn_of_slips(options)
        with placed.seeds.begun(seed):
            placed.prepare_reset(options)
            drawn = self.env.unwrapped.np_random if seed is None else None
            generator = drawn.bit_generator.state if isinstance(drawn, np.random.Generator) else None  # numpy only
            others = {name: value for name, value in (options or {}).items() if name not in RESET}
            self._observation, info = self.env.reset(seed=seed, options=others or None)
        placed.clear()
        placed.begin_episode(self.env.spec.id if self.env.spec else None, seed, generator)
        return self._observation, info | placed.info()

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment under the law, or as before if the law was removed.

        Raises:
            ImpactLawError: as raised by `Stepper.step`, except `DivergenceError`, which ends the episode.
            WrapperError: the environment turns out not to step MuJoCo in a known way.
        """
        placed = self._placed
        if placed is None:
            return self.env.step(action)
        placed.begin_step()
        start = placed.simulation()[1].time
        if _is_bad(action):
            placed.diverged = True
            return self._cut_off(placed, action)
        try:
            observation, reward, terminated, truncated, info = self.env.step(action)
        except Exception:
            if not placed.diverged:
                raise
            return self._cut_off(placed, action)
        placed.check_stepped(start)
        self._observation, self._reward = observation, reward
        truncated = truncated or placed.diverged
        placed.record_step(action, reward, terminated, truncated)
        return observation, reward, terminated, truncated, info | placed.info()

    def render(self) -> Any:
        """Return the environment's picture, drawn in its own OpenGL context."""
        renderer = getattr(self.env.unwrapped, "mujoco_renderer", None)
        if renderer is not None:
            make_current(renderer)
        return super().render()

    def close(self) -> None:
        """End the recording and close the environment."""
        if self._placed is not None:
            self._placed.close()
        renderer = getattr(self.env.unwrapped, "mujoco_renderer", None)
        if renderer is not None:
            free_contexts(renderer)
        super().close()

    def _cut_off(self, placed: PlacedLaw, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Return the result of a step that diverged: the last observation, reward 0, and a truncated episode."""
        reward = np.zeros_like(self._reward) if np.ndim(self._reward) else 0.0  # one zero for each of its objectives
        placed.record_step(action, reward, False, True)
        return self._observation, reward, False, True, placed.info()

    def __copy__(self) -> ImpactLaw:
        """Return another wrapper around the same environment, which shares the law in it."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        return twin

    def __getstate__(self) -> dict[str, Any]:
        """Replace the placed law by its options and seeds, since copies of most environments do not include it."""
        placed = None if self._placed is None else (*self._placed.options, self._placed.seeds)
        return self.__dict__ | {"_placed": placed}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Put the law into the copied environment."""
        self.__dict__.update(state)
        if state["_placed"] is not None:
            standing, in_force, seeds = state["_placed"]
            self._placed = place(self.env, standing, None, replace=True)
            self._placed.use(in_force)
            self._placed.seeds = seeds


def _is_bad(action: Any) -> bool:
    """Return whether an action contains a number that is not finite."""
    values = np.asarray(action)
    return values.dtype.kind == "f" and not math.isfinite(np.vdot(values, values)) and not np.isfinite(values).all()
