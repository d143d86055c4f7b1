"""Play the episodes of a cell, of a policy under a law, and compute their statistics."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

from impactlaw.errors import StudyError
from impactlaw.studies.environments import Conditions

LONGEST = 100_000
"""Number of steps after which an episode counts as endless."""
_EPISODES, _TRAINING = 2, 3  # separate the seeds of episodes from those of training


def episode_seeds(seed: int, episodes: int) -> list[int]:
    """Return the seeds of the episodes of a cell, which are the same under every law."""
    return [int(s) for s in np.random.SeedSequence([seed, _EPISODES]).generate_state(episodes)]


def training_seed(seed: int) -> int:
    """Return the seed of a training; its episodes differ from those of the cells."""
    return int(np.random.SeedSequence([seed, _TRAINING]).generate_state(1)[0])


def play(conditions: Conditions, begin: Callable[[], Callable[[Any], Any]], seeds: list[int]) -> dict[str, float]:
    """Play an episode from each seed, and return the results for a row of the table.

    Args:
        conditions: task, law and scheme.
        begin: returns the controller of a new episode.
        seeds: seeds of the episodes.

    Returns:
        score, the mean return; deviation, lowest and highest of the returns; steps, their mean number; collisions,
        their mean number, NaN for MuJoCo's own contacts; diverged, the number of episodes that ended by divergence.
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
    """Return the sum of rewards, the numbers of steps and of collisions, and whether the episode diverged."""
    discrete = isinstance(env.action_space, gymnasium.spaces.Discrete)
    observation, _ = env.reset(seed=seed)
    total, collisions, diverged = 0.0, 0.0, 0.0
    for step in range(1, LONGEST + 1):
        action = act(observation)
        observation, reward, terminated, truncated, info = env.step(int(action) if discrete else np.atleast_1d(action))
        if not math.isfinite(reward):  # an environment without a law would continue
            return total, step, collisions, 1.0
        total += float(reward)
        collisions += info.get("impact/count", math.nan)
        diverged += info.get("impact/diverged", 0)
        if terminated or truncated:
            return total, step, collisions, diverged
    raise StudyError(f"an episode of more than {LONGEST} steps: register the task with max_episode_steps")
