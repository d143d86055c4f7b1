"""Training by stable-baselines3: PPO in 64 environments, worlds of one batch where task and law allow it."""

# pyright: reportMissingImports=false
from __future__ import annotations

import importlib.util
import io
import zipfile
from typing import Any

from impactlaw.errors import MissingExtraError, StudyError
from impactlaw.studies.environments import Conditions

ENVIRONMENTS = 64
PPO_SETTINGS = {"n_steps": 256, "batch_size": 256}
"""As many steps between updates, 16 384, as by default in eight environments; larger batches for so many."""


def needs_training_extra(what: str) -> None:
    """Refuse where stable-baselines3 is not installed."""
    if importlib.util.find_spec("stable_baselines3") is None:
        raise MissingExtraError(what, "stable-baselines3", "train")


def train(conditions: Conditions, steps: int, seed: int) -> bytes:
    """Return a trained policy, as the zip file of stable-baselines3; on one processor it depends on nothing else.

    Args:
        conditions: what it is trained under.
        steps: of all environments together; PPO takes whole rollouts of 16 384.
        seed: of the network, the environments and the laws that are drawn.
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
    """Return the function from observation to action that a file of stable-baselines3 holds, without exploration."""
    import stable_baselines3
    from stable_baselines3.common.save_util import load_from_zip_file

    try:
        data, _, _ = load_from_zip_file(file, device="cpu")
        kind = (data or {})["policy_class"].__module__.split(".")[1].upper()
    except (ValueError, KeyError, zipfile.BadZipFile) as error:
        raise StudyError(f"a policy is a file that stable-baselines3 has saved: {error}") from None
    file.seek(0)
    model = getattr(stable_baselines3, kind, stable_baselines3.PPO).load(file, device="cpu")  # PPO's is "COMMON"
    return lambda observation: model.predict(observation, deterministic=True)[0]
