"""Train policies by PPO of stable-baselines3 in 64 environments, the worlds of one batch if task and law allow it."""

# pyright: reportMissingImports=false
from __future__ import annotations

import io
import zipfile
from typing import Any

from impactlaw.errors import StudyError
from impactlaw.studies.environments import Conditions

ENVIRONMENTS = 64
PPO_SETTINGS = {"n_steps": 256, "batch_size": 256}
"""With 64 environments these give 16 384 steps between updates, as the defaults do with eight, and larger batches."""


def train(conditions: Conditions, steps: int, seed: int) -> bytes:
    """Return a trained policy, as a zip file of stable-baselines3; on the same processor the result is reproducible.

    Args:
        conditions: task, law and scheme of the training.
        steps: number of steps of all environments together; PPO takes whole rollouts of 16 384.
        seed: seed of the network, the environments and the drawn laws.
    """
    import torch
    from gymnasium.spaces import Dict
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    from impactlaw.studies.policies.worlds import training_worlds

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    env = training_worlds(conditions, ENVIRONMENTS) or DummyVecEnv([conditions.make] * ENVIRONMENTS)
    try:
        network = "MultiInputPolicy" if isinstance(env.observation_space, Dict) else "MlpPolicy"
        model = PPO(network, env, seed=seed, device="cpu", **PPO_SETTINGS)
        model.learn(steps)
        file = io.BytesIO()
        model.save(file, exclude=["env"])
    finally:
        env.close()
        torch.set_num_threads(threads)
    return file.getvalue()


def load(file: io.BytesIO) -> Any:
    """Return the policy of a stable-baselines3 file as a function from observation to action, without exploration."""
    import stable_baselines3
    from stable_baselines3.common.save_util import load_from_zip_file

    try:
        data, _, _ = load_from_zip_file(file, device="cpu")
        kind = (data or {})["policy_class"].__module__.split(".")[1].upper()
    except (ValueError, KeyError, zipfile.BadZipFile) as error:
        raise StudyError(f"a policy is a file that stable-baselines3 has saved: {error}") from None
    file.seek(0)
    model = getattr(stable_baselines3, kind, stable_baselines3.PPO).load(file, device="cpu")  # kind is "COMMON" for PPO
    return lambda observation: model.predict(observation, deterministic=True)[0]
