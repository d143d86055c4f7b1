"""Score one scripted controller per environment, tuned to one impact law, under this law and under others.

Each controller knows the mechanics of its task and one law, and acts on observations only. Its score is the mean return
of an episode; an environment counts as solved if the score reaches the ``reward_threshold`` of its registration. The
same episodes (seeds) are played under every law, so that only the law differs.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, get_args

import gymnasium
import numpy as np
import pandas as pd
from tqdm import tqdm

import impactlaw.envs  # noqa: F401  (registers the environments)
from impactlaw.studies.policies.controllers import CONTROLLERS, Controller
from scripts.options import Count, read

Name = Literal["NewtonsCradle-v0", "Juggler-v0", "Billiards-v0", "RockingBlock-v0"]
_INELASTIC = "maximal-dissipation", None
LAWS: dict[Name, tuple[tuple[str, float | None], ...]] = {
    "NewtonsCradle-v0": (("reversal", 1.0), ("reversal", 0.8), ("moreau", 1.0), ("moreau", 0.5), _INELASTIC),
    "Juggler-v0": (("newton", 0.8), ("newton", 1.0), ("newton", 0.9), ("newton", 0.5), _INELASTIC),
    "Billiards-v0": (("moreau", 0.95), ("moreau", 0.8), ("moreau", 0.5), _INELASTIC, ("reversal", 0.95)),
    "RockingBlock-v0": (("moreau", 0.0), ("moreau", 0.5), ("moreau", 1.0), ("reversal", 0.8), ("reversal", 1.0)),
}
"""Laws under which each controller is played; it is tuned to the first one."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """Scores of the scripted controllers under several laws."""

    episodes: Count = 10
    """Episodes per environment and law."""
    environments: tuple[Name, ...] = get_args(Name)
    """Environments to play."""


def run(study: Study) -> Iterator[dict[str, object]]:
    """Play all episodes and yield one row per environment and law.

    Columns: environment, law, restitution, tuned (whether the controller is tuned to this law), score (mean return),
    lowest, highest, threshold, solved.
    """
    for name in study.environments:
        for i, (law, restitution) in enumerate(LAWS[name]):
            returns = [play(name, law, restitution, seed) for seed in range(study.episodes)]
            threshold = gymnasium.spec(f"impactlaw/{name}").reward_threshold
            assert threshold is not None
            score = float(np.mean(returns))
            row: dict[str, object] = {"environment": name, "law": law, "restitution": restitution, "tuned": i == 0}
            row |= {"score": score, "lowest": min(returns), "highest": max(returns)}
            yield row | {"threshold": threshold, "solved": score >= threshold}


def play(name: str, law: str, restitution: float | None, seed: int, controller: Controller | None = None) -> float:
    """Play one episode and return the sum of its rewards.

    Args:
        name: name of the environment, without its namespace.
        law: impact law of the environment.
        restitution: coefficient of the law.
        seed: seed of the episode.
        controller: controller to play; by default the one tuned to the environment's first law.
    """
    act: Controller = CONTROLLERS[name]() if controller is None else controller
    env = gymnasium.make(f"impactlaw/{name}", law=law, restitution=restitution)
    observation, _ = env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(np.atleast_1d(act(observation)))
        total += float(reward)
        over = terminated or truncated
    env.close()
    return total


def main(study: Study) -> None:
    """Print the scores of the controllers under several laws, one row per environment and law."""
    total = sum(len(LAWS[name]) for name in study.environments)
    table = pd.DataFrame(tqdm(run(study), total=total, unit="law", disable=None))
    print(table.to_string(index=False, float_format=lambda x: f"{x:.3g}", na_rep="-"))


if __name__ == "__main__":
    main(read(Study, __doc__))
