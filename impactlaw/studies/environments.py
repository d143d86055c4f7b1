"""Tasks under laws, as environments of gymnasium."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec, load_env_creator

from impactlaw.envs import ImpactEnv, ImpactLaw
from impactlaw.errors import StudyError
from impactlaw.studies.laws import StatedLaw
from impactlaw.studies.study import Scheme

_DRAWS = 1  # tells the draws of laws from all else that comes from the same seed


@dataclass(frozen=True)
class Conditions:
    """A task, the law that it is under, and the way to step it."""

    task: str
    law: StatedLaw
    scheme: Scheme

    def settings(self) -> dict[str, Any]:
        """Return what tells these conditions from others, as plain values; MuJoCo's own contacts have one way."""
        scheme = None if self.law.is_mujoco else self.scheme
        return {"task": self.task, "law": self.law.settings(), "scheme": scheme}

    def make(self) -> gymnasium.Env:
        """Return the environment.

        Raises:
            ImpactLawError: the law, or the scheme, does not fit the task.
        """
        own = is_own(self.task)
        if self.law.is_mujoco and own:
            raise StudyError(f"{self.task!r} is never under MuJoCo's own contacts: leave 'mujoco' out")
        if self.law.is_mujoco:
            return gymnasium.make(self.task, disable_env_checker=True)
        options: dict[str, Any] = self.law.draw(np.random.default_rng(0))
        if self.scheme == "soft":
            options["contact_model"] = "soft"
        else:
            options |= {"contact_model": "rigid", "scheme": self.scheme}
        if own:
            env = gymnasium.make(self.task, disable_env_checker=True, **options)
        else:
            env = ImpactLaw(gymnasium.make(self.task, disable_env_checker=True), **options)
        return DrawnLaw(env, self.law) if self.law.is_drawn else env


class DrawnLaw(gymnasium.Wrapper):
    """Draws the law of each episode."""

    def __init__(self, env: gymnasium.Env, law: StatedLaw):
        super().__init__(env)
        self._law, self._rng = law, np.random.default_rng()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; a seed settles the laws of this one and of those that follow."""
        if seed is not None:
            self._rng = draws(seed)
        return self.env.reset(seed=seed, options=self._law.draw(self._rng) | (options or {}))


def draws(seed: int) -> np.random.Generator:
    """Return what laws are drawn from."""
    return np.random.default_rng([seed, _DRAWS])


def is_own(task: str) -> bool:
    """Return whether a task is an `ImpactEnv`, which has a law without a wrapper.

    Raises:
        StudyError: there is no such task.
    """
    entry = spec_of(task).entry_point
    if entry is None:
        raise StudyError(f"task {task!r} is of many worlds at a time; name the task of one world")
    creator = load_env_creator(entry) if isinstance(entry, str) else entry
    return isinstance(creator, type) and issubclass(creator, ImpactEnv)


def spec_of(task: str) -> EnvSpec:
    """Return what gymnasium knows of a task.

    Raises:
        StudyError: there is no such task.
    """
    module, colon, name = task.rpartition(":")
    try:
        if colon:
            __import__(module)
        return gymnasium.spec(name)
    except (gymnasium.error.Error, ImportError) as error:
        raise StudyError(f"there is no task {task!r}: {error}") from None


def usual_scheme(task: str) -> Scheme:
    """Return how a task is stepped where nothing else is asked for."""
    return "event-driven" if is_own(task) else "soft"
