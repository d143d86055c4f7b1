"""Many worlds of this package's environments whose action drives a mocap body: Juggler and RockingBlock."""

from __future__ import annotations

import warnings
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from impactlaw.batch import Batch
from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.envs.tasks.driven import DrivenEnv
from impactlaw.envs.tasks.juggler import Juggler
from impactlaw.envs.tasks.rocking_block import RockingBlock
from impactlaw.envs.vector.asked_laws import asked_laws, each
from impactlaw.envs.vector.task import Outcome, step_worlds
from impactlaw.envs.vector.worlds import VectorWorlds
from impactlaw.errors import ActionError, OptionError, UncompiledWarning
from impactlaw.models import START
from impactlaw.stepping.compatibility import check_count

_OF_WORLDS = {
    "law", "restitution", "scheme", "frame_skip", "nthread", "batch_options", "max_episode_steps", "autoreset_mode",
}  # fmt: skip


class Driven:
    """The task of an environment in many worlds.

    Args:
        env: a single environment that defines the task; it is not stepped.
    """

    def __init__(self, env: DrivenEnv):
        self._env, self.model, self.frame_skip = env, env.model, int(env.frame_skip)
        self.keyframe = int(env.model.key(START).id)
        self.observation_space: spaces.Box = env.observation_space  # pyright: ignore[reportAttributeAccessIssue]
        self.action_space: spaces.Box = env.action_space  # pyright: ignore[reportAttributeAccessIssue]

    def bind(self, batch: Batch) -> None:
        """Bind the task to the worlds of a batch."""
        self._batch = batch
        self._time, self._qpos, self._qvel = (batch.bind(name) for name in ("time", "qpos", "qvel"))
        self._position = batch.bind("mocap_pos")[:, self._env.mocap]
        self._quaternion = batch.bind("mocap_quat")[:, self._env.mocap]
        self._place, self._speed, self._goal = np.zeros((3, batch.nsim))
        self._fields = batch.state, self._place, self._speed

    def start(self, world: int, rng: np.random.Generator) -> None:
        """Draw an episode, and set a world to its beginning."""
        self._qpos[world], self._qvel[world], self._goal[world] = self._env.draw(rng)
        self._place[world] = self._speed[world] = 0.0

    def observe(self) -> np.ndarray:
        """Return the observations of all worlds."""
        seen = self._env.see(self._qpos, self._qvel, self._place, self._speed, self._goal)
        return np.clip(seen, self.observation_space.low, self.observation_space.high)

    def step(self, worlds: np.ndarray, action: np.ndarray) -> Outcome:
        """Take one step of the environment in some worlds.

        Raises:
            ActionError: an action is not finite.
        """
        if not np.isfinite(action).all():
            raise ActionError(f"actions are finite numbers, got {action[~np.isfinite(action).all(axis=1)][0]}")
        part = np.clip(action.astype(float), self.action_space.low, self.action_space.high)[:, 0]
        before = [field[worlds] for field in self._fields]
        diverged = np.zeros(len(worlds), bool)
        for _ in range(self._env.frame_skip):
            going = worlds[~diverged]
            self._drive(going, part[~diverged])
            diverged[~diverged] = step_worlds(self._batch, going)
        for now, was in zip(self._fields, before, strict=True):
            now[worlds[diverged]] = was[diverged]
        reward, over = self._env.rate(self._qpos[worlds], self._qvel[worlds], self._goal[worlds])
        return Outcome(np.asarray(reward), np.asarray(over), diverged, {})

    def _drive(self, worlds: np.ndarray, part: np.ndarray) -> None:
        """Move the driven bodies by a timestep, except in the first timestep of an episode; see `ImpactEnv`."""
        moves = self._time[worlds] > 0.0
        worlds, part = worlds[moves], part[moves]
        place, speed = self._env.DRIVE.advance(self._place[worlds], self._speed[worlds], part, self.model.opt.timestep)
        self._place[worlds], self._speed[worlds] = place, speed
        position, quaternion = self._position[worlds], self._quaternion[worlds]
        self._env.move(place, position, quaternion)
        self._position[worlds], self._quaternion[worlds] = position, quaternion


def _make(kind: type[DrivenEnv], num_envs: int, **options: Any) -> VectorEnv:
    """Return compiled worlds, or a set of single environments if an option is given that only these support."""
    single = sorted(options.keys() - _OF_WORLDS)
    if options.get("scheme", "time-stepping") != "time-stepping":
        single.append("scheme")
    if single:
        return _side_by_side(f"impactlaw/{kind.__name__}-v0", num_envs, options, ", ".join(single))
    env = kind(scheme="time-stepping", frame_skip=options.get("frame_skip"))
    law = kind.LAW if options.get("law") is None else options["law"]
    return VectorWorlds(
        Driven(env), num_envs, asked_laws(env.model, law, options.get("restitution"), num_envs),
        nthread=options.get("nthread", 0), max_episode_steps=options.get("max_episode_steps"),
        autoreset_mode=options.get("autoreset_mode", AutoresetMode.NEXT_STEP), options=options.get("batch_options"),
    )  # fmt: skip


class Alongside(SyncVectorEnv):
    """Single environments, stepped one after another, whose laws can be assigned like those of compiled worlds.

    Raises:
        OptionError: the number of assigned values is not that of the environments.
        UnknownNameError: there is no such law.
        RestitutionError: the restitution does not fit the law.
    """

    @property
    def law(self) -> tuple[Any, ...]:
        """The law in force in each environment; assign one for all, or a list with one for each."""
        return self.get_attr("law")

    @law.setter
    def law(self, law: Any) -> None:
        self.set_attr("law", each("laws", law, self.num_envs))

    @property
    def restitution(self) -> tuple[Any, ...]:
        """The restitution of each environment; assign one for all, or a list with one for each."""
        return self.get_attr("restitution")

    @restitution.setter
    def restitution(self, restitution: Any) -> None:
        self.set_attr("restitution", each("values of restitution", restitution, self.num_envs))


def _side_by_side(name: str, num_envs: int, options: dict[str, Any], single: str) -> Alongside:
    """Return single environments, and warn that these options rule out compiled worlds."""
    check_count("num_envs", num_envs)
    for worlds in ("nthread", "batch_options"):
        if worlds in options:
            raise OptionError(f"{worlds} is for compiled worlds, which do not have {single}: leave one of them out")
    if isinstance(options.get("law"), LawDistribution):
        raise OptionError(f"a LawDistribution is for compiled worlds, which do not have {single}: use RandomLaw here")
    autoreset = options.pop("autoreset_mode", AutoresetMode.NEXT_STEP)
    own = [dict(options) for _ in range(num_envs)]
    for option in ("law", "restitution"):
        if option in options:
            for one, value in zip(own, each(f"values of {option}", options[option], num_envs), strict=True):
                one[option] = value
    made = Alongside([partial(gymnasium.make, name, **one) for one in own], autoreset_mode=autoreset)
    warnings.warn(
        f"only single environments have {single}: these are {num_envs} of them, stepped one after another, and not "
        'compiled worlds; leave it out for worlds, or pass vectorization_mode="sync"',
        UncompiledWarning,
        stacklevel=5,
    )
    return made


def make_juggler(num_envs: int, **options: Any) -> VectorEnv:
    """Return time-stepped worlds of `Juggler`.

    With an option that only single environments support, such as "log", "friction" or another scheme, return single
    environments that are stepped one after another, with an `UncompiledWarning`.

    Args:
        num_envs: number of worlds.
        options: "law", "restitution" and "frame_skip" of the environment. "law" and "restitution" may also be a list or
            an array with one value per world; "law" may be a `LawDistribution`, from which each world draws a law for
            each episode. Further "nthread" and "batch_options" of `impactlaw.Batch`, "max_episode_steps" and
            "autoreset_mode".
    """
    return _make(Juggler, num_envs, **options)


def make_rocking_block(num_envs: int, **options: Any) -> VectorEnv:
    """Return time-stepped worlds of `RockingBlock`; for the options see `make_juggler`."""
    return _make(RockingBlock, num_envs, **options)
