"""Many worlds of gymnasium's planar robots, Hopper, Walker2d and HalfCheetah, with their observations and rewards."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NoReturn

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.envs.vector.asked_laws import asked_laws
from impactlaw.envs.vector.laws_of_worlds import OF_BATCH
from impactlaw.envs.vector.spatial import Robot, Spatial
from impactlaw.envs.vector.task import Outcome
from impactlaw.envs.vector.worlds import VectorWorlds
from impactlaw.errors import OptionError
from impactlaw.laws import Law

_IS = {"scheme": "time-stepping", "log": None, "render_mode": None}
"""Options of single environments, with the values that describe rigid worlds and are therefore accepted."""
_PICTURES = ("width", "height", "camera_id", "camera_name")
_OF_SINGLE = (*_IS, *OF_BATCH, *_PICTURES, "log_every", "contacts", "limits", "impulse_in_cfrc_ext")


class Planar(Robot):
    """The task of a planar robot."""

    def __init__(self, name: str, **options: Any):
        super().__init__(name, **options)
        env = self._env
        self._cheetah = name.startswith("HalfCheetah")
        self.observation_space: spaces.Box = spaces.Box(-np.inf, np.inf, env.observation_space.shape, np.float64)
        self._hidden = int(env._exclude_current_positions_from_observation)
        self._healthy = getattr(env, "_healthy_reward", 0.0)
        self._ends = bool(getattr(env, "_terminate_when_unhealthy", False))

    def observe(self) -> np.ndarray:
        """Return the observations of all worlds."""
        seen = self._qvel if self._cheetah else np.clip(self._qvel, -10.0, 10.0)
        return np.concatenate([self._qpos[:, self._hidden :], seen], axis=1)

    def step(self, worlds: np.ndarray, action: np.ndarray) -> Outcome:
        """Take one step of the environment in some worlds."""
        before = self._qpos[worlds, :1]
        diverged = self._advance(worlds, action)
        qpos, qvel = self._qpos[worlds], self._qvel[worlds]
        velocity = (qpos[:, 0] - before[:, 0]) / self._env.dt
        healthy = self._is_healthy(qpos, qvel)
        forward = self._env._forward_reward_weight * velocity
        cost = self._env._ctrl_cost_weight * np.square(action).sum(axis=1, dtype=action.dtype)
        reward = forward + self._healthy * healthy - cost
        info = {"x_position": qpos[:, 0], "x_velocity": velocity, "reward_forward": forward, "reward_ctrl": -cost}
        if not self._cheetah:
            height = qpos[:, 1] - self._first[0][1]
            info |= {"reward_survive": self._healthy * healthy, "z_distance_from_origin": height}
        return Outcome(reward, ~healthy & self._ends, diverged, info)

    def _is_healthy(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        if self._cheetah:
            return np.ones(len(qpos), bool)
        state = np.concatenate([qpos[:, 2:], qvel], axis=1)
        parts = (qpos[:, 1], "z"), (qpos[:, 2], "angle"), (state, "state")
        ranges = [(value, *getattr(self._env, f"_healthy_{name}_range", (-np.inf, np.inf))) for value, name in parts]
        inside = [(low < value) & (value < high) for value, low, high in ranges]
        return inside[0] & inside[1] & inside[2].all(axis=1)


def make_robots(
    num_envs: int,
    *,
    name: str,
    law: str | Law | list[str | Law] | LawDistribution = "moreau",
    restitution: Any = None,
    contact_model: Literal["rigid", "soft"] = "rigid",
    nthread: int = 0,
    max_episode_steps: int | None = None,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    batch_options: Mapping[str, Any] | None = None,
    **options: Any,
) -> VectorWorlds:
    """Return worlds of one of gymnasium's robots under an impact law.

    Args:
        num_envs: number of worlds.
        name: name of gymnasium's environment.
        law: a law or its name, or a list with one for each world, or a `LawDistribution`, from which each world draws a
            law for each episode.
        restitution: argument of laws given by name, or a list or an array with one for each world; 0 if a law needs one
            and neither this argument nor the scene gives one.
        contact_model: "rigid", which is time stepped, or "soft"; see `impactlaw.Batch`.
        nthread: number of threads; 0 for one per processor.
        max_episode_steps: number of steps after which an episode is truncated.
        autoreset_mode: what resets a world whose episode has ended, see `VectorWorlds`.
        batch_options: options of `impactlaw.Batch`.
        options: arguments of gymnasium's environment, except those for pictures; rigid worlds also accept
            scheme="time-stepping".

    Raises:
        UnknownNameError: there is no such law, contact model or autoreset_mode.
        RestitutionError: a law does not fit the scene, or a restitution is given for a law that has its own.
        SceneError: compiled code does not cover a law.
        OptionError: the number of worlds or threads is invalid, the number of laws is not that of the worlds, or an
            option is one that only single environments support.
    """
    options = _of_robots(name, options, contact_model)
    task = (Spatial if name in ("Ant-v5", "Humanoid-v5") else Planar)(name, **options)
    chosen = asked_laws(task.model, law, restitution, num_envs, usual=0.0)
    return VectorWorlds(
        task, num_envs, chosen, contact_model=contact_model, nthread=nthread, max_episode_steps=max_episode_steps,
        autoreset_mode=autoreset_mode, options=batch_options,
    )  # fmt: skip


def refuse_one_robot(*, name: str, **_: Any) -> NoReturn:
    """Raise an OptionError that says how one robot is made, since `make_robots` makes many worlds only."""
    raise OptionError(
        f'impactlaw/{name} is made by gymnasium.make_vec("impactlaw/{name}", num_envs), as worlds that step together; '
        f'for a single environment take ImpactLaw(gymnasium.make("{name}"), law, ...)'
    )


def _of_robots(name: str, options: dict[str, Any], contact_model: str) -> dict[str, Any]:
    """Return the options of gymnasium's environment; raise on those for single environments or rigid worlds."""
    if contact_model == "soft" and options.get("scheme") is not None:
        raise OptionError("scheme means nothing to soft steps; leave it out")
    left = {option: value for option, value in options.items() if option not in _IS or value != _IS[option]}
    single = [f"{option}={left[option]!r:.50}" for option in _OF_SINGLE if option in left]
    if single:
        batch = [option for option in OF_BATCH if option in left]
        instead = f"{', '.join(batch)} can be given in batch_options; " if batch else ""
        raise OptionError(
            f"these worlds are time stepped, or soft, and not drawn or recorded, and do not take {', '.join(single)}: "
            f'{instead}put ImpactLaw(gymnasium.make("{name}"), law, ...) into a SyncVectorEnv or AsyncVectorEnv of '
            "gymnasium for the rest"
        )
    return left
