"""Make tasks under laws as gymnasium environments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
from gymnasium.envs.registration import EnvSpec, load_env_creator

from impactlaw.envs import ImpactEnv, ImpactLaw, RandomLaw
from impactlaw.envs.vector.walkers import refuse_one_robot
from impactlaw.errors import StudyError
from impactlaw.studies.laws import StatedLaw
from impactlaw.studies.study import Scheme


@dataclass(frozen=True)
class Conditions:
    """A task, its law, and its way to step."""

    task: str
    law: StatedLaw
    scheme: Scheme

    def settings(self) -> dict[str, Any]:
        """Return plain values that identify these conditions; with MuJoCo's own contacts the scheme has no effect."""
        scheme = None if self.law.is_mujoco else self.scheme
        return {"task": self.task, "law": self.law.settings(), "scheme": scheme}

    def make(self) -> gymnasium.Env:
        """Return the environment."""
        own = is_own(self.task)
        if self.law.is_mujoco and own:
            raise StudyError(f"{self.task!r} is never under MuJoCo's own contacts: leave 'mujoco' out")
        if self.law.is_mujoco:
            return gymnasium.make(self.task, disable_env_checker=True)
        options = self.law.distribution().examples()[0]
        if self.scheme == "soft":
            options["contact_model"] = "soft"
        else:
            options |= {"contact_model": "rigid", "scheme": self.scheme}
        if own:
            env = gymnasium.make(self.task, disable_env_checker=True, **options)
        else:
            env = ImpactLaw(gymnasium.make(self.task, disable_env_checker=True), **options)
        return RandomLaw(env, self.law.laws, self.law.restitution) if self.law.is_drawn else env


def is_own(task: str) -> bool:
    """Return whether a task is an `ImpactEnv`, which takes a law without a wrapper."""
    entry = spec_of(task).entry_point
    creator = load_env_creator(entry) if isinstance(entry, str) else entry
    if creator is None or creator is refuse_one_robot:
        raise StudyError(f"task {task!r} is of many worlds at a time; name the task of one world")
    return isinstance(creator, type) and issubclass(creator, ImpactEnv)


def spec_of(task: str) -> EnvSpec:
    """Return gymnasium's specification of a task; for "module:id", import the module first."""
    module, colon, name = task.rpartition(":")
    try:
        if colon:
            __import__(module)
        return gymnasium.spec(name)
    except (gymnasium.error.Error, ImportError) as error:
        raise StudyError(f"there is no task {task!r}: {error}") from None


def usual_scheme(task: str) -> Scheme:
    """Return the default scheme of a task."""
    return "event-driven" if is_own(task) else "soft"
