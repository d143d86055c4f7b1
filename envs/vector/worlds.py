"""A vectorized environment over `impactlaw.Batch`: one task in many worlds, each with its own law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.envs.law_options import PortableSpec, check_reset
from impactlaw.envs.vector.asked_laws import Asked
from impactlaw.envs.vector.laws_of_worlds import LawsOfWorlds
from impactlaw.envs.vector.task import Task
from impactlaw.errors import ActionError, CopyError, OptionError, SettledError, UnknownNameError, UnsupportedError
from impactlaw.laws import Law
from impactlaw.settled import Settled
from impactlaw.stepping.compatibility import check_count

_OPTIONS = ("law", "restitution")
_ANEW = "make new worlds"
_SINGLE = "make single environments, which have it, or new worlds"


class VectorWorlds(PortableSpec, VectorEnv):  # pyright: ignore[reportIncompatibleVariableOverride]  (spec)
    """Many worlds of one task under impact laws, as a gymnasium `VectorEnv`.

    If the simulation of a world diverges, its state returns to the start of the step, its episode is truncated, and
    ``info["impact/diverged"]`` is 1. World i starts after ``reset(seed=s)`` like a single environment after
    ``reset(seed=s + i)``.

    At resets and steps, ``info`` has "impact/law" and "impact/restitution" of all worlds, as set through this
    environment; the restitution is NaN if a law does not have exactly one.

    Args:
        task: the task of the worlds.
        num_envs: number of worlds.
        law: the law of all worlds, or a list with one for each, or a `LawDistribution` from which each world draws a
            law for each episode.
        contact_model: option of `Batch`.
        nthread: number of threads; 0 for one per processor.
        max_episode_steps: number of steps after which an episode is truncated; None for no limit.
        autoreset_mode: what resets a world whose episode has ended, an `AutoresetMode` of gymnasium or its value: the
            next step, which ignores the action; the same step, which tells the end in ``info["final_obs"]`` and
            ``info["final_info"]``; or only `reset` ("Disabled").
        options: further options of `Batch`.

    Attributes:
        batch: the worlds; restitution and laws can also be set there between steps.

    Raises:
        OptionError: a number is invalid, the number of laws is not that of the worlds, or options are not a mapping.
        UnknownNameError: there is no such law, no such option, or no such autoreset_mode.
        RestitutionError: a law does not fit the scene.
        SceneError: compiled code does not cover the scene, or a law.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012  (as gymnasium declares it)

    autoreset_mode = Settled(_ANEW)
    nthread, frame_skip, max_episode_steps = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    friction, on_inadmissible, rest_speed = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    contact_model, scheme, log, log_every = Settled(_SINGLE), Settled(_SINGLE), Settled(_SINGLE), Settled(_SINGLE)

    def __init__(
        self,
        task: Task,
        num_envs: int,
        law: Asked | list[Asked] | LawDistribution,
        *,
        contact_model: Literal["rigid", "soft"] = "rigid",
        nthread: int = 0,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        options: Mapping[str, Any] | None = None,
    ):
        check_count("num_envs", num_envs)
        if max_episode_steps is not None:
            check_count("max_episode_steps", max_episode_steps)
        autoreset = _autoreset_mode(autoreset_mode)
        self._task, self.num_envs, self._limit = task, num_envs, max_episode_steps
        self.single_observation_space, self.single_action_space = task.observation_space, task.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._laws = LawsOfWorlds(
            task.model, law, num_envs, contact_model=contact_model, nthread=nthread, options=options or {}
        )
        self.batch = self._laws.batch
        task.bind(self.batch)
        self._rngs = [seeding.np_random(None)[0] for _ in range(num_envs)]
        self._elapsed, self._over = np.zeros(num_envs, int), np.ones(num_envs, bool)
        self._begun = False
        # options that single environments or a `Batch` also have; they can be read, but not set
        given, rigid = options or {}, self.batch.contact_model == "rigid"
        self.autoreset_mode = autoreset
        self.metadata = self.metadata | {"autoreset_mode": autoreset}
        self.nthread, self.frame_skip, self.max_episode_steps = nthread, task.frame_skip, max_episode_steps
        self.friction, self.rest_speed = given.get("friction", "coulomb"), given.get("rest_speed")
        self.contact_model, self.log, self.log_every = self.batch.contact_model, None, 1
        self.scheme = "time-stepping" if rigid else None
        self.on_inadmissible = given.get("on_inadmissible") or ("project" if rigid else None)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a new episode in all worlds, or in those selected by ``options["reset_mask"]``, bool (n,).

        Args:
            seed: one seed, or a list with one for each world, where None leaves the generator of that world unchanged.
            options: "reset_mask"; "law" and "restitution" for the episodes that begin, as in `ImpactEnv.reset`.

        Raises:
            UnknownNameError: there is no such option, or no such law.
            OptionError: the seeds or the mask do not fit the worlds, or the options are not a mapping.
            RestitutionError: the restitution does not fit the law.
        """
        check_reset(options, ("reset_mask", *_OPTIONS))
        given = dict(options or {})
        mask = given.pop("reset_mask", np.ones(self.num_envs, bool))
        chosen, seeds = self._chosen(mask), self._seeds(seed)
        self._begin(chosen, [seeds[i] for i in chosen], given)
        self._begun = True
        return self._task.observe(), self._laws.info()

    def _chosen(self, mask: Any) -> np.ndarray:
        """Return the numbers of the worlds in a mask; raise OptionError unless it is one bool per world."""
        mask = np.asarray(mask)
        if mask.dtype != bool or mask.shape != (self.num_envs,):
            raise OptionError(
                f"reset_mask is one bool for each of {self.num_envs} worlds, got {mask.dtype} of shape {mask.shape}"
            )
        return np.flatnonzero(mask)

    def _seeds(self, seed: Any) -> list[int | None]:
        """Return the seed of each world, or None; raise OptionError for invalid seeds or a wrong number of them."""
        if isinstance(seed, int | np.integer):
            seeds: list[Any] = [int(seed) + i for i in range(self.num_envs)] if seed >= 0 else [seed]
        else:
            seeds = [None] * self.num_envs if seed is None else list(seed) if np.iterable(seed) else [seed]
        whole = all(one is None or (isinstance(one, int | np.integer) and one >= 0) for one in seeds)
        if not whole or len(seeds) != self.num_envs:
            raise OptionError(
                f"a seed is a whole number, 0 or more, or a list with one for each of {self.num_envs} worlds, "
                f"got {seed!r:.100}"
            )
        return [None if one is None else int(one) for one in seeds]

    def set_attr(self, name: str, values: Any) -> None:
        """Set "law" or "restitution" of all worlds, to one value or one per world, from the next step on, permanently.

        A restitution is combined with a law that was given by name. A `LawDistribution` is no longer drawn from.

        Raises:
            SettledError: name is another attribute, which is fixed when the worlds are made.
            OptionError: the number of values is not that of the worlds.
            UnknownNameError: there is no such law; no law changes.
            RestitutionError: the restitution does not fit the law; no law changes.
        """
        if name not in _OPTIONS:
            raise SettledError(f"{name} of worlds is settled when they are made; only law and restitution can be set")
        self._laws.set(name, values)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return an attribute as `get_attr` does; gymnasium's vector environments also allow this.

        Raises:
            UnsupportedError: the attribute is a method: worlds are not environments with methods of their own.
        """
        if args or kwargs or callable(getattr(self, name)):
            raise UnsupportedError(
                f"worlds are no environments that have a method {name} each: call that of all worlds, if there is one, "
                "or put single environments into a SyncVectorEnv of gymnasium"
            )
        return self.get_attr(name)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return "law" or "restitution" in force in each world, or another attribute, repeated for each world."""
        return getattr(self, name) if name in _OPTIONS else (getattr(self, name),) * self.num_envs

    @property
    def law(self) -> tuple[Law, ...]:
        """The law in force in each world; assigning to it calls `set_attr`."""
        return self._laws.in_force

    @law.setter
    def law(self, law: Any) -> None:
        self.set_attr("law", law)

    @property
    def restitution(self) -> tuple[float, ...]:
        """The restitution in force in each world, NaN if a law has not exactly one; assigning calls `set_attr`."""
        return tuple(self._laws.info()["impact/restitution"].tolist())

    @restitution.setter
    def restitution(self, restitution: Any) -> None:
        self.set_attr("restitution", restitution)

    def __copy__(self) -> VectorWorlds:
        """Raise CopyError, as the batch does: a copy would step the same worlds."""
        raise CopyError("worlds cannot be copied: they are in memory that compiled code holds; make other ones")

    def _begin(
        self, worlds: np.ndarray, seeds: Sequence[int | None], given: Mapping[str, Any] = MappingProxyType({})
    ) -> None:
        self._laws.begin(worlds.tolist(), given, seeds)  # first, so that a refused law leaves the worlds unchanged
        self.batch.reset(worlds.tolist(), self._task.keyframe)
        for i, seed in zip(worlds.tolist(), seeds, strict=True):
            if seed is not None:
                self._rngs[i] = seeding.np_random(seed)[0]
            self._task.start(i, self._rngs[i])
        self._elapsed[worlds], self._over[worlds] = 0, False

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step all worlds whose episode is running, and reset the others as ``autoreset_mode`` says.

        Raises:
            ResetNeeded: there was no reset yet, or none since an episode has ended that steps do not reset (gymnasium's
                own error).
            ActionError: the actions are not numbers, one row per world.
        """
        if not self._begun:
            raise ResetNeeded("episodes begin with reset(); call it before step()")
        over, going = np.flatnonzero(self._over), np.flatnonzero(~self._over)
        if len(over) and self.autoreset_mode is not AutoresetMode.NEXT_STEP:
            raise ResetNeeded(
                f"episodes have ended in the worlds {over.tolist()}, and steps do not reset them: call reset() with "
                'options={"reset_mask": terminated | truncated}'
            )
        actions = self._checked(actions)
        reward, terminated = np.zeros(self.num_envs), np.zeros(self.num_envs, bool)
        truncated = np.zeros(self.num_envs, bool)
        before = self._counts()
        found = self._task.step(going, actions[going])
        told = {name: (now - before[name])[going] for name, now in self._counts().items()}
        told |= {"impact/diverged": found.diverged.astype(int)}
        reward[going] = np.where(found.diverged, 0.0, found.reward)
        terminated[going], truncated[going] = found.terminated & ~found.diverged, found.diverged
        self._elapsed[going] += 1
        if self._limit is not None:
            truncated[going] |= self._elapsed[going] >= self._limit
        if len(over):
            self._begin(over, [None] * len(over))
        self._over = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            info = self._reset_ended(found.info | told)
        else:
            info = self._of_all(going, found.info | told)
        return self._task.observe(), reward, terminated, truncated, info | self._laws.info()

    def _reset_ended(self, told: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Reset the worlds whose episode has ended; return info of the others, and the end of these in it.

        Args:
            told: entries of info of all worlds.
        """
        mask, observed, laws = self._over.copy(), self._task.observe(), self._laws.info()
        ended, others = np.flatnonzero(mask), np.flatnonzero(~mask)
        final = np.empty(self.num_envs, object)
        for i in ended:
            final[i] = observed[i]
        last = dict(told) | {name: value for name, value in laws.items() if not name.startswith("_")}
        self._begin(ended, [None] * len(ended))
        return self._of_all(others, {name: value[others] for name, value in told.items()}) | {
            "final_obs": final,
            "_final_obs": mask,
            "final_info": self._of_all(ended, {name: value[ended] for name, value in last.items()}),
            "_final_info": mask.copy(),
        }

    def _of_all(self, worlds: np.ndarray, told: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Return entries of info of all worlds, with masks, from those of some worlds."""
        info, has_it = dict[str, Any](), np.isin(np.arange(self.num_envs), worlds)
        for name, value in told.items():
            empty = np.empty if value.dtype == object else np.zeros
            info[name] = empty((self.num_envs, *value.shape[1:]), value.dtype)
            info[name][worlds], info[f"_{name}"] = value, has_it.copy()
        return info

    def _counts(self) -> dict[str, np.ndarray]:
        batch = self.batch
        counted = batch.impact_count, batch.inadmissible_count, batch.short_steps
        return dict(zip(("impact/count", "impact/inadmissible", "impact/short"), counted, strict=True))

    def _checked(self, actions: Any) -> np.ndarray:
        """Return the actions of all worlds as an array; raise ActionError unless they are numbers of this shape."""
        wanted = self.action_space.shape
        try:
            found = np.asarray(actions)
            found = found if found.dtype.kind == "f" else np.asarray(actions, dtype=float)
        except (TypeError, ValueError):
            raise ActionError(f"actions are numbers of shape {wanted}, got {actions!r:.100}") from None
        if found.shape != wanted:
            raise ActionError(f"actions are numbers of shape {wanted}, one row for each world, got shape {found.shape}")
        return found


def _autoreset_mode(mode: Any) -> AutoresetMode:
    """Return gymnasium's mode; raise UnknownNameError if there is none of this value."""
    modes = [one.value for one in AutoresetMode]
    if not isinstance(mode, (AutoresetMode, str)) or mode not in (*AutoresetMode, *modes):
        raise UnknownNameError("autoreset_mode", mode, modes)
    return AutoresetMode(mode)
