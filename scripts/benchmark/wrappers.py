"""What the wrapper `ImpactLaw` costs next to the plain environment, under the same random actions, in one process.

Both take the same episode again and again, in turns and in short pieces, and the fastest time of each piece counts:
what other processes take from the machine is left out.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pandas as pd

from impactlaw.envs import ImpactLaw

from .timing import MICRO, no_collection

ENVIRONMENTS = ("Hopper-v5", "Walker2d-v5", "HalfCheetah-v5", "Ant-v5", "Humanoid-v5")
_PIECE = 10  # environment steps


@dataclass(frozen=True, kw_only=True)
class WrapperCost:
    """Which environments, for how long."""

    wrapped: tuple[str, ...] = ENVIRONMENTS
    """Ids of gymnasium's MuJoCo environments."""
    restitution: float = 0.5
    """Coefficient of Moreau's law."""
    steps: int = 400
    """Environment steps of the episode; what ends before is reset."""
    repetitions: int = 15
    """Times that it is taken."""


def run(study: WrapperCost, progress: Callable[[], object] = lambda: None) -> pd.DataFrame:
    """Return one row per environment: microseconds of a step, plain and wrapped, their ratio, collisions per step."""
    rows = []
    for name in study.wrapped:
        envs: dict[str, Any] = {"plain": gymnasium.make(name)}
        envs["wrapped"] = ImpactLaw(gymnasium.make(name), "moreau", study.restitution)
        envs["plain"].action_space.seed(0)
        actions = [envs["plain"].action_space.sample() for _ in range(study.steps)]
        best = {kind: np.full(-(-study.steps // _PIECE), np.inf) for kind in envs}
        collisions = 0
        for repetition in range(study.repetitions):
            for kind in list(envs)[:: 1 if repetition % 2 else -1]:
                seconds, found = _episode(envs[kind], actions)
                best[kind] = np.minimum(best[kind], seconds)
                collisions = max(collisions, found)
        cost = {kind: MICRO * float(pieces.sum()) / study.steps for kind, pieces in best.items()}
        row: dict[str, object] = {"environment": name, "plain_us": cost["plain"], "wrapped_us": cost["wrapped"]}
        rows.append(row | {"ratio": cost["wrapped"] / cost["plain"], "collisions": collisions / study.steps})
        progress()
    return pd.DataFrame(rows)


def _episode(env: Any, actions: list[np.ndarray]) -> tuple[np.ndarray, int]:
    """Return the seconds of each piece, and the number of collisions."""
    env.reset(seed=0)
    seconds, collisions = [], 0
    bounds = [*range(0, len(actions), _PIECE), len(actions)]
    for first, last in pairwise(bounds):
        with no_collection():
            start = time.perf_counter()
            for number in range(first, last):
                *_, terminated, truncated, info = env.step(actions[number])
                collisions += info.get("impact/count", 0)
                if terminated or truncated:
                    env.reset(seed=number)
            seconds.append(time.perf_counter() - start)
    return np.array(seconds), collisions
