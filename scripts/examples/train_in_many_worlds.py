"""Train stable-baselines3's PPO on HalfCheetah in 64 worlds at once, with a random restitution in each episode.

One sees the mean reward of a step grow within a minute, and how many steps per second the training takes. Needs
`impactlaw[train]`.
"""

import time

import gymnasium
import torch  # pyright: ignore[reportMissingImports]
from stable_baselines3 import PPO  # pyright: ignore[reportMissingImports]

from impactlaw.envs import LawDistribution
from impactlaw.studies.policies.worlds import Worlds

torch.set_num_threads(1)  # the networks are small
STEPS = 200_000
laws = LawDistribution(("moreau",), (0.0, 0.8))
worlds = Worlds(gymnasium.make_vec("impactlaw.envs:impactlaw/HalfCheetah-v5", 64, law=laws, nthread=1))


def mean_reward(model: PPO) -> float:
    """Return the mean reward of 100 steps of all worlds."""
    seen, total = worlds.reset(), 0.0
    for _ in range(100):
        seen, reward, _, _ = worlds.step(model.predict(seen, deterministic=True)[0])
        total += reward.mean() / 100
    return total


policy = PPO("MlpPolicy", worlds, n_steps=64, batch_size=512, seed=0, device="cpu")
print(f"before: a step has {mean_reward(policy):.2f}")
begun = time.perf_counter()
policy.learn(STEPS)
print(f"{STEPS / (time.perf_counter() - begun):.0f} steps of the environment a second, training included")
print(f"after: a step has {mean_reward(policy):.2f}")
worlds.close()
