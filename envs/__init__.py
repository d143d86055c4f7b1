"""Gymnasium environments whose outcome depends on the impact law; importing this package registers them."""

import gymnasium

from impactlaw.envs.base import ImpactEnv
from impactlaw.envs.law_distribution import LawDistribution
from impactlaw.envs.logs.replay import restart
from impactlaw.envs.placing.bare_dm_control import placed_law, put_law
from impactlaw.envs.random_law import RandomLaw
from impactlaw.envs.rendering import choose_backend
from impactlaw.envs.tasks.billiards import Billiards
from impactlaw.envs.tasks.juggler import Juggler
from impactlaw.envs.tasks.newtons_cradle import NewtonsCradle
from impactlaw.envs.tasks.rocking_block import RockingBlock
from impactlaw.envs.wrapper import ImpactLaw

__all__ = [
    "Billiards", "ImpactEnv", "ImpactLaw", "Juggler", "LawDistribution", "NewtonsCradle", "RandomLaw", "RockingBlock",
    "placed_law", "put_law", "restart",
]  # fmt: skip

for _entry_point, _worlds, _steps, _solved in (
    (NewtonsCradle, None, 300, 0.95),
    (Juggler, "make_juggler", 1000, 800.0),
    (Billiards, None, None, 3.0),
    (RockingBlock, "make_rocking_block", 250, 225.0),
):
    gymnasium.register(
        f"impactlaw/{_entry_point.__name__}-v0",
        entry_point=f"{_entry_point.__module__}:{_entry_point.__name__}",
        vector_entry_point=_worlds and f"impactlaw.envs.vector.driven:{_worlds}",
        max_episode_steps=_steps,
        reward_threshold=_solved,
        disable_env_checker=True,  # if the first reset fails, gymnasium's checker makes every later step fail too
    )
for _name in ("Hopper-v5", "Walker2d-v5", "HalfCheetah-v5", "Ant-v5", "Humanoid-v5"):
    gymnasium.register(
        f"impactlaw/{_name}",
        entry_point="impactlaw.envs.vector.walkers:refuse_one_robot",
        vector_entry_point="impactlaw.envs.vector.walkers:make_robots",
        max_episode_steps=1000,
        kwargs={"name": _name},
    )
choose_backend()
