"""A cell: episodes of a policy under a law, and what they were worth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

from impactlaw.errors import StudyError
from impactlaw.studies.environments import Conditions

LONGEST = 100_000
"""Steps after which an episode is taken for endless."""
_EPISODES, _TRAINING = 2, 3  # tell seeds of one purpose from those of another


def episode_seeds(seed: int, episodes: int) -> list[int]:
    """Return the seeds of the episodes of a cell: the same under every law."""
    return [int(s) for s in np.random.SeedSequence([seed, _EPISODES]).generate_state(episodes)]


def training_seed(seed: int) -> int:
    """Return the seed of a training, whose episodes are not those of the cells."""
    return int(np.random.SeedSequence([seed, _TRAINING]).generate_state(1)[0])


def play(conditions: Conditions, begin: Callable[[], Callable[[Any], Any]], seeds: list[int]) -> dict[str, float]:
    """Play an episode from each seed and return what belongs to a row of the table.

    Returns:
        score, the mean return; deviation of the returns, lowest and highest; mean number of steps; mean number of
        collisions, NaN for MuJoCo's own contacts; diverged, the episodes that left the finite numbers, which ends them.
    """
    env = conditions.make()
    try:
        episodes = np.array([_episode(env, begin(), seed) for seed in seeds])
    finally:
        env.close()
    returns, steps, collisions, diverged = episodes.T
    found = {"score": returns.mean(), "deviation": returns.std(), "lowest": returns.min(), "highest": returns.max()}
    found |= {"steps": steps.mean(), "collisions": collisions.mean(), "diverged": diverged.sum()}
    return {name: float(value) for name, value in found.items()}


def _episode(env: gymnasium.Env, act: Callable[[Any], Any], seed: int) -> tuple[float, int, float, float]:
    """Return the sum of rewards, the number of steps and of collisions, and whether it diverged."""
    discrete = isinstance(env.action_space, gymnasium.spaces.Discrete)
    observation, _ = env.reset(seed=seed)
    total, collisions, diverged = 0.0, 0.0, 0.0
    for step in range(1, LONGEST + 1):
        action = act(observation)
        observation, reward, terminated, truncated, info = env.step(int(action) if discrete else np.atleast_1d(action))
        if not math.isfinite(reward):  # environments without a law go on
            return total, step, collisions, 1.0
        total += float(reward)
        collisions += info.get("impact/count", math.nan)
        diverged += info.get("impact/diverged", 0)
        if terminated or truncated:
            return total, step, collisions, diverged
    raise StudyError(f"an episode of more than {LONGEST} steps: register the task with max_episode_steps")
