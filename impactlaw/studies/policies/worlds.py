"""Provide many worlds for training, for tasks that have them (`impactlaw.envs.vector`)."""

# pyright: reportMissingImports=false
from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from stable_baselines3.common.vec_env import VecEnv

from impactlaw.errors import SceneError, UnsupportedError
from impactlaw.studies.environments import Conditions, is_own, spec_of


def training_worlds(conditions: Conditions, count: int) -> Worlds | None:
    """Return worlds of a task; None if it has none, or if they do not support the scheme or a law."""
    law, task = conditions.law, spec_of(conditions.task).id
    name = task if is_own(task) else f"impactlaw/{task}"
    spec = gymnasium.registry.get(name)
    if law.is_mujoco or spec is None or spec.vector_entry_point is None:
        return None
    options: dict[str, Any] = {"nthread": 1, "law": law.distribution()}
    if conditions.scheme == "soft" and not is_own(task):
        options["contact_model"] = "soft"
    elif conditions.scheme != "time-stepping":
        return None
    try:
        worlds: Any = gymnasium.make_vec(name, count, "vector_entry_point", **options)
    except SceneError:
        return None
    return Worlds(worlds)


class Worlds(VecEnv):
    """Worlds of one task as a `VecEnv` of stable-baselines3, which resets a world in the step that ends its episode."""

    def __init__(self, worlds: VectorEnv[Any, Any, Any]):
        self._worlds: Any = worlds
        self._actions = np.zeros(0)
        super().__init__(worlds.num_envs, worlds.single_observation_space, worlds.single_action_space)

    def reset(self) -> np.ndarray:
        """Begin an episode in all worlds, from the seeds set before."""
        observed, _ = self._worlds.reset(seed=self._seeds)
        self._reset_seeds()
        return observed

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Step all worlds, and reset those whose episode has ended."""
        observed, reward, terminated, truncated, _ = self._worlds.step(self._actions)
        over = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(over):
            infos[i] = {"terminal_observation": observed[i].copy(), "TimeLimit.truncated": not terminated[i]}
        if over.any():
            observed, _ = self._worlds.reset(options={"reset_mask": over})
        return observed, reward.astype(np.float32), over, infos

    def close(self) -> None:
        """Close the worlds."""
        self._worlds.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of each of some worlds, or of all; only law and restitution differ between worlds.

        Raises:
            AttributeError: worlds have no such attribute.
        """
        found = self._worlds.get_attr(attr_name)
        return [found[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise UnsupportedError: the worlds of a training are fixed when they are made."""
        raise UnsupportedError(
            f"{attr_name} of the worlds of a training cannot be set: they are settled when they are made; "
            "name other laws or tasks in the study, or make worlds of your own with gymnasium.make_vec"
        )

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Raise UnsupportedError: worlds are stepped together, and are not separate environments."""
        raise UnsupportedError(
            f"{method_name} cannot be called on one world: worlds of a training are stepped together, and there is no "
            "environment for each of them; read what all have with get_attr, or make a single one with gymnasium.make"
        )

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each world: no world is wrapped."""
        return [False for _ in self._get_indices(indices)]
