"""An impact law for environments of others: gymnasium's MuJoCo ones, gymnasium-robotics' and dm_control's."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from impactlaw.envs.placed import LawOptions, PlacedLaw, RunLog
from impactlaw.envs.placed_gymnasium import place
from impactlaw.errors import WrapperError
from impactlaw.events import ImpactEvent
from impactlaw.laws import Law

if TYPE_CHECKING:
    import dm_env


class ImpactLaw(gymnasium.Wrapper, RecordConstructorArgs):
    """Puts an impact law into an environment that steps MuJoCo, in one line and without a fork of it.

    ``ImpactLaw(gymnasium.make("Hopper-v5"), law="moreau", restitution=0.5)``. It covers gymnasium's MuJoCo environments
    (v4, v5 and what derives from `MujocoEnv`), the robots of gymnasium-robotics, and dm_control's suite and composer
    tasks through shimmy (bare ones: `put_law`). Observations, rewards and spaces stay the environment's; steps in which
    nothing collides stay bit for bit what they were. What a reset simulates is under the law too where the
    environment simulates it in the same way as its steps.

    ``info`` holds the entries of `ImpactTally`, summed over the timesteps of an environment step, zeros at a reset;
    `events` holds the collisions themselves. The wrapper may be anywhere among others, survives copies, pickling and
    ``gymnasium.make(env.spec)``, and follows an environment that compiles a new model.

    ``cfrc_ext``, which Ant and Humanoid observe and are charged for, is what MuJoCo's contacts do within a timestep:
    the impulses of the law, which act in no time, are not in it (they are in `events`), so that a hard landing costs
    less than without the law.

    If the simulation leaves the finite numbers, where MuJoCo would silently go on from its initial state, the episode
    is truncated, not terminated, since no state of the task was reached: the observation is the last one before, the
    reward is 0, and ``info["impact/diverged"]`` is 1.

    Args:
        env: the environment, wrapped or not.
        law: name of a law (`impactlaw.make_law`), "scene" for what the MJCF itself carries, or a `Law`.
        restitution: what the law takes.
        contact_model: "soft" keeps MuJoCo's contacts and friction between collisions; with "rigid" contact is the
            law's, with exact Coulomb friction, and what overlaps after a reset is opened.
        scheme: of rigid contact: "time-stepping", if not given, or "event-driven"; see `Stepper`.
        rest_speed: closing speed, m/s, above which a contact collides; see `Stepper`.
        on_inadmissible: what to do with an outcome of the law outside of S(v-): "raise", "project" it onto S(v-), or
            "allow" it; ``info["impact/inadmissible"]`` counts them.
        log: file to record every timestep to, until `close`. A model that the environment compiles later goes to
            ``name-2.rrd`` and so on. A copy of the wrapper does not record.

    Raises:
        WrapperError: the environment does not step MuJoCo in a known way, or has a law already.
        UnknownNameError: no such law or option, or the law is for contacts that the scene cannot have.
        RestitutionError: the restitution does not fit the law.
        SceneError: the scene has a flex or delays, and contact_model is "rigid"; or an option means nothing there.
        RecordingError: the log cannot be written.
    """

    def __init__(
        self,
        env: gymnasium.Env,
        law: str | Law,
        restitution: Any = None,
        *,
        contact_model: Literal["rigid", "soft"] = "soft",
        scheme: Literal["event-driven", "time-stepping"] | None = None,
        rest_speed: float | None = None,
        on_inadmissible: Literal["raise", "project", "allow"] = "project",
        log: str | Path | None = None,
    ):
        RecordConstructorArgs.__init__(
            self,
            law=law,
            restitution=restitution,
            contact_model=contact_model,
            scheme=scheme,
            rest_speed=rest_speed,
            on_inadmissible=on_inadmissible,
            log=log,
        )
        super().__init__(env)
        self._options = LawOptions(law, restitution, contact_model, scheme, rest_speed, on_inadmissible)
        self._placed: PlacedLaw | None = place(env, self._options, _run_log(log, env.spec.id if env.spec else None))
        self._observation: Any = None

    @property
    def law(self) -> Law | None:
        """The law, or None once it was removed."""
        return None if self._placed is None else self._placed.law

    @property
    def events(self) -> tuple[ImpactEvent, ...]:
        """The collisions of the last step, all its timesteps, in order."""
        return () if self._placed is None else self._placed.events

    def remove(self) -> gymnasium.Env:
        """Take the law off again and return the environment inside, which steps as it did before."""
        if self._placed is not None:
            self._placed.remove()
            self._placed = None
        return self.env

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode."""
        placed = self._placed
        if placed is None:
            return self.env.reset(seed=seed, options=options)
        placed.record_seed(seed)
        self._observation, info = self.env.reset(seed=seed, options=options)
        placed.clear()
        return self._observation, info | placed.info()

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment under the law; without a law, as the environment does.

        Raises:
            ImpactLawError: as by `Stepper.step`, but for `DivergenceError`, which ends the episode.
        """
        placed = self._placed
        if placed is None:
            return self.env.step(action)
        placed.clear()
        try:
            observation, reward, terminated, truncated, info = self.env.step(action)
        except Exception:
            if not placed.diverged:
                raise
            return self._observation, 0.0, False, True, placed.info()
        self._observation = observation
        return observation, reward, terminated, truncated or placed.diverged, info | placed.info()

    def close(self) -> None:
        """End the recording and close the environment."""
        if self._placed is not None:
            self._placed.close()
        super().close()

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what the environment inside is stepped by: most of them are copied without it."""
        return self.__dict__ | {"_placed": self._placed is not None, "_observation": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Put the law into the copy."""
        self.__dict__.update(state)
        self._placed = place(self.env, self._options, None, replace=True) if state["_placed"] else None


def put_law(
    env: dm_env.Environment,
    law: str | Law,
    restitution: Any = None,
    *,
    contact_model: Literal["rigid", "soft"] = "soft",
    scheme: Literal["event-driven", "time-stepping"] | None = None,
    rest_speed: float | None = None,
    on_inadmissible: Literal["raise", "project", "allow"] = "project",
    log: str | Path | None = None,
) -> PlacedLaw:
    """Put an impact law into a bare dm_control environment, suite or composer, and return a handle on it.

    ``placed = put_law(suite.load("hopper", "hop"), "moreau", 0.5)``. The environment itself is changed; the handle has
    the collisions of the last environment step (``events``), the numbers of `ImpactLaw`'s info (``info()``), and
    takes the law off again (``remove()``) or ends the recording (``close()``). If the simulation leaves the finite
    numbers, dm_control raises its `PhysicsError`, as without the law. A copy of the environment has no law.

    Args:
        env: the environment.
        law: as for `ImpactLaw`, like the arguments below.
        restitution: what the law takes.
        contact_model: "soft" or "rigid".
        scheme: of rigid contact: "time-stepping", if not given, or "event-driven".
        rest_speed: closing speed, m/s, above which a contact collides.
        on_inadmissible: "raise", "project" or "allow".
        log: file to record every timestep to.

    Raises:
        WrapperError: the environment is not one of dm_control, or has a law already.
        UnknownNameError: no such law or option, or the law is for contacts that the scene cannot have.
        RestitutionError: the restitution does not fit the law.
        SceneError: the scene has a flex or delays, and contact_model is "rigid"; or an option means nothing there.
        RecordingError: the log cannot be written.
    """
    if isinstance(env, gymnasium.Env) or not hasattr(env, "physics"):
        hint = "use impactlaw.envs.ImpactLaw" if isinstance(env, gymnasium.Env) else "it has no physics"
        raise WrapperError(f"{type(env).__name__} is not an environment of dm_control: {hint}")
    from impactlaw.envs.placed_dm_control import OnDmControl

    options = LawOptions(law, restitution, contact_model, scheme, rest_speed, on_inadmissible)
    return OnDmControl(env, options, _run_log(log, None))


def _run_log(path: str | Path | None, scene: str | None) -> RunLog | None:
    return None if path is None else RunLog(path, scene)
