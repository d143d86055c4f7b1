"""Environments shared by tests of recordings, and episodes of them."""

import numpy as np
import pytest
from own_envs import bare
from wrapped import hopper

JUGGLER = "impactlaw.envs:impactlaw/Juggler-v0"


def play(env, episodes, steps=40):
    """Take random actions; return the states, actions and rewards of each episode."""
    data = env.unwrapped.data
    rng, seen = np.random.default_rng(0), []
    for episode in range(episodes):
        env.reset(seed=5 if episode == 0 else None)
        states, actions, rewards = [np.append(data.qpos, data.qvel)], [], []
        for _ in range(steps):
            actions.append(rng.uniform(-1, 1, env.action_space.shape))
            _, reward, terminated, truncated, _ = env.step(actions[-1])
            rewards.append(reward)
            states.append(np.append(data.qpos, data.qvel))
            if terminated or truncated:
                break
        seen.append((np.array(states), np.array(actions), np.array(rewards)))
    return seen


def makers(**options):
    return {
        "own": lambda: bare(JUGGLER, **options),
        "own, soft": lambda: bare(JUGGLER, contact_model="soft", **options),
        "wrapped": lambda: hopper(**options),
        "wrapped, rigid": lambda: hopper(contact_model="rigid", **options),
    }


every_maker = pytest.mark.parametrize("name", makers())
